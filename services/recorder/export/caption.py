"""What is written on a picture, and the cameras' own pictures at its foot."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from services.recorder.export.theme import Theme

_TEXT_SHARE = 0.032
"""Height of the text, of the picture's."""
_SMALL_SHARE = 0.024
_MARGIN_SHARE = 0.028
_GAP_SHARE = 0.012
_MOST_INSETS = 16

Caption = list[tuple[str, str, str]]
"""Name, value, and the widest that the value gets: so nothing jumps when numbers change."""


def write(picture: NDArray[np.uint8], caption: Caption, theme: Theme) -> None:
    """Write the caption along the top of an (H, W, 3) picture."""
    height = picture.shape[0]
    font = ImageFont.load_default(max(10, round(_TEXT_SHARE * height)))
    margin = round(_MARGIN_SHARE * height)
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    x, space = float(margin), font.getlength("n")
    for name, value, widest in caption:
        if name:
            draw.text((x, margin), name, font=font, fill=theme.faint_ink)
            x += font.getlength(name) + 0.6 * space
        room = font.getlength(widest)
        draw.text((x + room - font.getlength(value), margin), value, font=font, fill=theme.ink)
        x += room + 2.2 * space
    picture[:] = np.asarray(image)


def put_insets(
    picture: NDArray[np.uint8], insets: Mapping[int, NDArray[np.float64]], foot: int, theme: Theme
) -> None:
    """Put pictures (h, w, 3), sRGB 0 to 1, in a row into the lowest `foot` rows of a picture."""
    height, width = picture.shape[:2]
    margin, gap = round(_MARGIN_SHARE * height), round(_GAP_SHARE * height)
    cameras = sorted(insets)[:_MOST_INSETS]
    if not cameras:
        return
    tall, wide = insets[cameras[0]].shape[:2]
    inset_height = foot - margin
    inset_width = round(inset_height * wide / tall)
    fits = (width - 2 * margin - (len(cameras) - 1) * gap) // len(cameras)
    if inset_width > fits:
        inset_width, inset_height = fits, round(fits * tall / wide)
    if inset_width < 8:
        return
    font = ImageFont.load_default(max(8, round(_SMALL_SHARE * height)))
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    total = len(cameras) * inset_width + (len(cameras) - 1) * gap
    left, top = (width - total) // 2, height - margin - inset_height
    for camera in cameras:
        small: Any = Image.fromarray((insets[camera] * 255).astype(np.uint8))
        small = small.resize((inset_width, inset_height), Image.Resampling.LANCZOS)
        image.paste(small, (left, top))
        frame = (left - 1, top - 1, left + inset_width, top + inset_height)
        draw.rectangle(frame, outline=theme.faint_ink)
        corner = (left + 4, top + 2)
        draw.text(corner, str(camera), font=font, fill="#ffffff")
        left += inset_width + gap
    picture[:] = np.asarray(image)
