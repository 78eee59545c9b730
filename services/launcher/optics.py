"""What a camera sees from side to side."""

import math


def half_view_deg(width_px: int, height_px: int, vfov_deg: float) -> float:
    """Return half the horizontal field of view of square pixels, from the vertical one."""
    return math.degrees(math.atan(width_px / height_px * math.tan(math.radians(vfov_deg / 2))))
