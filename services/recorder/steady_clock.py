"""Wall time that never goes back, whoever sets the machine's clock meanwhile."""

import time
from collections.abc import Callable


def steady_clock() -> Callable[[], int]:
    """Return a clock, ns: the wall's time of now, and from here on as long as really passes."""
    offset_ns = time.time_ns() - time.monotonic_ns()
    return lambda: offset_ns + time.monotonic_ns()
