"""Which cameras say nothing: told when it begins and ends, and summed up now and then."""

from collections import Counter
from collections.abc import Collection

PERIOD_S = 10.0
"""A camera's silence is told once in so long, and what was not told is summed up as often."""


class Silence:
    """Turns the missing clouds of every instant into few lines.

    On a busy machine, now one camera is missing and now another: a line per instant, or per
    change, would be a flood in which nobody finds the camera that is broken.
    """

    def __init__(self) -> None:
        self._silent: set[int] = set()
        """Whose silence was told, and not its end."""
        self._told_s: dict[int, float] = {}
        self._missed: Counter[int] = Counter()
        """Clouds that were missed, and not told."""
        self._num_instants = 0
        self._since_s: float | None = None

    def note(
        self, tick: int, used: Collection[int], missing: Collection[int], now_s: float
    ) -> list[str]:
        """Take an instant in; return the lines to be logged, mostly none.

        Args:
            tick: which. used, missing: cameras. now_s: monotonic.
        """
        began_s = now_s if self._since_s is None else self._since_s
        self._since_s = began_s
        self._num_instants += 1
        new = [
            camera
            for camera in sorted(set(missing) - self._silent)
            if now_s - self._told_s.get(camera, -PERIOD_S) >= PERIOD_S
        ]
        back = sorted(self._silent & set(used))
        self._missed.update(set(missing).difference(new))
        self._told_s.update(dict.fromkeys(new, now_s))
        # Who is neither used nor missing has left the bus: nobody waits for it.
        self._silent = (self._silent | set(new)) & set(missing)
        lines = []
        if new:
            lines.append(f"tick {tick}: nothing from cameras {_listed(new)}")
        if back:
            lines.append(f"tick {tick}: cameras {_listed(back)} speak again")
        if now_s - began_s >= PERIOD_S:
            if self._missed:
                lines.append(self._summed_up(tick, now_s - began_s))
            self._missed.clear()
            self._num_instants, self._since_s = 0, None
        return lines

    def _summed_up(self, tick: int, span_s: float) -> str:
        each = ", ".join(f"{count} of camera {c}" for c, count in sorted(self._missed.items()))
        return (
            f"tick {tick}: of {self._num_instants} instants in {span_s:.0f} s "
            f"these clouds were missing, too: {each}"
        )


def _listed(cameras: Collection[int]) -> str:
    return ", ".join(map(str, cameras))
