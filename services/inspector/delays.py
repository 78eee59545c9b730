"""How long messages are under way: our reception less the sender's stamp."""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

_WINDOW = 256


class Told(NamedTuple):
    """Seconds, of the newest messages of a key."""

    min_s: float
    mean_s: float
    p95_s: float
    max_s: float
    shutter_s: float | None
    """Mean time since the shutter, where a message tells that; else None."""


@dataclass
class Delays:
    """One key's delays; between machines they hold the difference of the clocks too."""

    _sent_s: deque[float] = field(default_factory=lambda: deque(maxlen=_WINDOW))
    _shutter_s: deque[float] = field(default_factory=lambda: deque(maxlen=_WINDOW))

    def add(self, received_ns: int, t_pub_ns: int, t_capture_ns: int | None) -> None:
        """Count a message."""
        self._sent_s.append((received_ns - t_pub_ns) * 1e-9)
        if t_capture_ns is not None:
            self._shutter_s.append((received_ns - t_capture_ns) * 1e-9)

    @property
    def clocks_differ(self) -> bool:
        """Whether something came before it was sent."""
        return min(self._sent_s, default=0.0) < 0.0

    def told(self) -> Told | None:
        """Tell of the newest; None when nothing came."""
        if not self._sent_s:
            return None
        sent_s = np.array(self._sent_s)
        return Told(
            float(sent_s.min()),
            float(sent_s.mean()),
            float(np.percentile(sent_s, 95)),
            float(sent_s.max()),
            float(np.mean(self._shutter_s)) if self._shutter_s else None,
        )
