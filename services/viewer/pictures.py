"""What the cameras see, small enough to be shown."""

import io

import numpy as np

from schemas.camera import ColorImage
from schemas.cloud import DepthCloud
from services.viewer.frusta import depth_image
from services.viewer.newest import Newest
from services.viewer.primitives import Image

MAX_WIDTH_PX = 320
"""Half of 640: as much as the panel is wide."""


def pictures(newest: Newest) -> dict[int, Image]:
    """Return a picture per camera: its colours if it sends any, else its depths."""
    found = {
        camera: depth_image(cloud, MAX_WIDTH_PX)
        for camera, cloud in newest.clouds.items()
        if isinstance(cloud, DepthCloud)
    }
    for camera, picture in newest.pictures.items():
        image = _decoded(picture)
        if image is not None:
            found[camera] = image
    return dict(sorted(found.items()))


def _decoded(picture: ColorImage) -> Image | None:
    """Return a JPEG's pixels, shrunk while they are decoded; None if it is no picture."""
    from PIL import Image as Pillow  # In the viewer's extra.

    try:
        with Pillow.open(io.BytesIO(bytes(picture.data)), formats=("JPEG",)) as opened:
            opened.draft("RGB", (MAX_WIDTH_PX, MAX_WIDTH_PX))
            opened.thumbnail((MAX_WIDTH_PX, MAX_WIDTH_PX))
            return np.asarray(opened.convert("RGB"))
    except (OSError, ValueError, Pillow.DecompressionBombError):
        return None
