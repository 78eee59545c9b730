"""View files: one pose of the optical frame per line, `x y z qx qy qz qw`.

The format of next-best-view planning: the first line may be the number of views.
"""

from pathlib import Path

import numpy as np
from pydantic import ValidationError

from schemas.geometry import Pose
from services.kernels.rigid import FloatArray
from services.planner.errors import ViewFileError

MAX_VIEWS = 100_000
MAX_BYTES = 16 << 20
_MOST_DIGITS = 9  # Of a count; Python refuses to read numbers of thousands.


def read_views(path: Path) -> list[FloatArray]:
    """Read a view file.

    Returns:
        Transforms (4, 4) from the optical frame to the frame the file is written in.

    Raises:
        ViewFileError: If the file is missing, too large, or a line is not a view.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ViewFileError(f"{path}: larger than {MAX_BYTES >> 20} MiB; this is no view file")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ViewFileError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ViewFileError(f"{path}: not a text file") from error
    return parse_views(text, str(path))


def parse_views(text: str, name: str = "views") -> list[FloatArray]:
    """Parse the text of a view file; `#` starts a comment.

    Raises:
        ViewFileError: If a line is not a view, the count does not agree, or there is no view.
    """
    views: list[FloatArray] = []
    declared: int | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if len(words) == 1 and declared is None and not views and _is_count(words[0]):
            declared = int(words[0])
            continue
        views.append(_view(words, f"{name}:{number}"))
        if len(views) > MAX_VIEWS:
            raise ViewFileError(f"{name}: more than {MAX_VIEWS} views")
    if declared is not None and declared != len(views):
        raise ViewFileError(f"{name}: the first line says {declared} views, there are {len(views)}")
    if not views:
        raise ViewFileError(f"{name}: no view; each line is `x y z qx qy qz qw`")
    return views


def _is_count(word: str) -> bool:
    return word.isdecimal() and len(word) <= _MOST_DIGITS


def format_views(views: list[FloatArray]) -> str:
    """Write views the way `parse_views` reads them."""
    poses = [Pose.from_matrix(view) for view in views]
    rows = [" ".join(f"{part:.12g}" for part in (*p.position, *p.orientation)) for p in poses]
    return "\n".join([str(len(views)), *rows, ""])


def _view(words: list[str], place: str) -> FloatArray:
    if len(words) != 7:
        raise ViewFileError(f"{place}: {len(words)} values; a view is `x y z qx qy qz qw`")
    try:
        x, y, z, qx, qy, qz, qw = (float(word) for word in words)
    except ValueError as error:
        raise ViewFileError(f"{place}: {error}") from error
    if not np.isfinite([x, y, z, qx, qy, qz, qw]).all():
        raise ViewFileError(f"{place}: {' '.join(words)!r} must be finite numbers")
    try:
        return Pose(position=(x, y, z), orientation=(qx, qy, qz, qw)).matrix()
    except ValidationError as error:
        rule = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise ViewFileError(f"{place}: {rule}") from error
