"""Whether the ground on which an object is looked for holds the way that it drives."""

import math

from services.world.path import PathKind, open_motion

_MOMENTS = 200
"""At which the way is looked at; between two of a lap it goes less than 4 % of its extent."""
_EDGE_M = 0.5
"""Between the way and the suggested ground's border; the object itself is about as wide."""

Arena = tuple[float, float, float, float]


def refuse_what_leaves(
    arena: Arena,
    path: PathKind,
    semi_axes_m: tuple[float, float],
    lap_s: float,
    lasting_s: float | None,
) -> None:
    """Refuse a way that leaves the arena.

    Args:
        arena: least x, least y, greatest x, greatest y, m.
        path: its kind.
        semi_axes_m: of the path.
        lap_s: time once round it.
        lasting_s: how long the object drives; None: without end.

    Raises:
        ValueError: With when and where it leaves, and what ground would do.
    """
    motion = open_motion(path, semi_axes_m, lap_s)
    # Closed paths have been everywhere after a lap; a line goes on.
    seen_s = lap_s if lasting_s is None else lasting_s if path == "line" else min(lasting_s, lap_s)
    times_s = [seen_s * k / _MOMENTS for k in range(_MOMENTS + 1)]
    places = [motion.at(t_s).position_m for t_s in times_s]
    xs, ys = zip(*places, strict=True)
    low_x, low_y, high_x, high_y = arena
    for t_s, (x, y) in zip(times_s, places, strict=True):
        if not (low_x <= x <= high_x and low_y <= y <= high_y):
            least = (math.floor(10 * (min(each) - _EDGE_M)) / 10 for each in (xs, ys))
            most = (math.ceil(10 * (max(each) + _EDGE_M)) / 10 for each in (xs, ys))
            raise ValueError(
                f"target map with path {path}: after {t_s:.3g} s the object leaves the arena "
                f"{' '.join(f'{each:g}' for each in arena)} at x {x:.3g}, y {y:.3g}, and nobody "
                "would see it any more; choose --arena "
                f"{' '.join(f'{each:.1f}' for each in (*least, *most))} or more, "
                "a smaller --semi-axes, or another path"
            )
    if path == "line" and lasting_s is None:
        raise ValueError(
            "target map with path line and forever: no arena is long enough; choose a path that "
            "comes back, or a duration"
        )
