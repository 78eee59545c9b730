"""What the cameras see, as pictures in the panel."""

import base64
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from services.viewer.colours import camera_colour
from services.viewer.primitives import Image

if TYPE_CHECKING:
    import viser

_JPEG_QUALITY = 75
_GRID = "display:grid;grid-template-columns:1fr 1fr;gap:8px;padding:4px 12px 8px;font-size:0.8em"
_PICTURE = "display:block;width:100%;border-bottom:3px solid rgb"


class WebImages:
    """A picture per camera, two in a row; one whose camera has gone goes too.

    One page of HTML with the pictures inside it. Viser's own images are files of the browser's
    memory that it throws away when the next comes: one that is still being read then is an error on
    the console, and one that is removed while it is updated is another.
    """

    def __init__(self, server: "viser.ViserServer") -> None:
        with server.gui.add_folder("Camera images", order=40):
            self._page: Any = server.gui.add_html("")

    def draw(self, images: Mapping[int, Image]) -> None:
        """Show these and no others."""
        figures = "".join(_figure(camera, image) for camera, image in images.items())
        self._page.content = f'<div style="{_GRID}">{figures}</div>' if figures else ""


def _figure(camera: int, image: Image) -> str:
    height, width = image.shape[:2]
    colour = ",".join(map(str, camera_colour(camera)))
    data = base64.b64encode(_jpeg(image)).decode()
    return (
        f'<figure style="margin:0"><figcaption>Camera {camera}</figcaption>'
        f'<img alt="" width="{width}" height="{height}" decoding="sync" '
        f'style="{_PICTURE}({colour});height:auto" src="data:image/jpeg;base64,{data}"></figure>'
    )


def _jpeg(image: Image) -> bytes:
    from PIL import Image as Pillow  # In the viewer's extra.

    with io.BytesIO() as file:
        Pillow.fromarray(image).save(file, "JPEG", quality=_JPEG_QUALITY)
        return file.getvalue()
