"""Whose clock is so far off that its stamps are of no use; the map itself goes by ticks."""

MAX_OFFSET_S = 10.0
"""Farther apart than a cloud can be late: links are given up after 3 s."""
_NS = 1e-9


class Clocks:
    """Follows the senders' stamps; says once when they are off, and when they are right again."""

    def __init__(self) -> None:
        self._off_s: dict[int, float] = {}

    def is_off(self, camera: int) -> bool:
        """Whether a camera's last stamps were out of reach."""
        return camera in self._off_s

    def note(self, camera: int, stamp_ns: int, now_ns: int) -> str | None:
        """Take a stamp in; return the line to be logged, if any.

        Args:
            camera: whose. stamp_ns: its wall clock. now_ns: ours, when its word came.
        """
        off_s = (stamp_ns - now_ns) * _NS
        was_off = self.is_off(camera)
        if abs(off_s) <= MAX_OFFSET_S:
            self._off_s.pop(camera, None)
            return f"camera {camera}: its stamps agree with our clock again" if was_off else None
        self._off_s[camera] = off_s
        if was_off:
            return None
        side = "ahead of" if off_s > 0.0 else "behind"
        return (
            f"camera {camera}: its stamps are {abs(off_s):.0f} s {side} our clock; it is fused "
            "by its ticks and left out of the latency"
        )
