"""Curves of the last instants."""

from collections import deque

import numpy as np

from schemas.map import MapSummary
from schemas.metrics import Quality
from schemas.status import ServiceStatus
from services.kernels.rigid import FloatArray

NUM_SAMPLES = 300
_HEADLINE = 1  # Of the two tolerances, the wider: two voxels.
_SILENT_S = 3.0
_FORGOTTEN_S = 30.0
"""A camera that has been silent for so long is not to come back, or comes as a new one."""

Curves = tuple[FloatArray, ...]
"""x, then a y per curve, all of one length; NaN where a curve has no sample."""


class History:
    """Rows of an x and a fixed number of ys; the oldest goes first."""

    def __init__(self, num_curves: int) -> None:
        self._rows: deque[tuple[float, ...]] = deque(maxlen=NUM_SAMPLES)
        self._num_columns = 1 + num_curves

    def add(self, x: float, *ys: float) -> None:
        """Append a sample; an x before the last one is a new run."""
        if self._rows and x < self._rows[-1][0]:
            self._rows.clear()
        if self._rows and x == self._rows[-1][0]:
            self._rows.pop()  # Told twice.
        self._rows.append((x, *ys))

    def curves(self) -> Curves:
        """Return the columns; two equal rows of nothing before the first sample."""
        if not self._rows:
            return tuple(np.zeros(1) for _ in range(self._num_columns))
        table = np.array(self._rows, np.float64)
        return tuple(np.ascontiguousarray(column) for column in table.T)


class Plots:
    """All that is plotted."""

    def __init__(self) -> None:
        self.quality = History(3)
        """Shares in percent: of what is visible, of the whole surface, F-score."""
        self.fusing = History(2)
        """Milliseconds: fusing, shutter to map."""
        self._rates: dict[int, tuple[float, float]] = {}
        self.rates = History(0)
        """Hz per camera of `cameras`, over wall time since the first sample, s."""
        self._first_s: float | None = None
        self.cameras: tuple[int, ...] = ()

    def add_quality(self, message: Quality) -> None:
        """Take in how good an instant's map is."""
        score = message.stamp_true[_HEADLINE]
        shares = (score.coverage_visible, score.coverage, score.f_score)
        self.quality.add(message.t_ns * 1e-9, *(100 * share for share in shares))

    def add_summary(self, message: MapSummary) -> None:
        """Take in how long an instant took."""
        self.fusing.add(message.t_ns * 1e-9, message.fuse_ms, message.latency_ms)

    def add_status(self, status: ServiceStatus, now_s: float) -> None:
        """Take in a camera's heartbeat; others' are passed over."""
        if status.service == "camera" and status.instance.isdecimal():
            camera = int(status.instance)
            key = f"cams/{camera}/cloud"
            for topic in status.topics:
                if topic.sent and topic.key == key:
                    self._rates[camera] = topic.rate_hz, now_s

    def sample_rates(self, now_s: float) -> None:
        """Append what all cameras said last; who is silent stands at zero, then is forgotten."""
        self._first_s = now_s if self._first_s is None else self._first_s
        self._rates = {i: got for i, got in self._rates.items() if now_s - got[1] < _FORGOTTEN_S}
        cameras = tuple(sorted(self._rates))
        if cameras != self.cameras:
            self.cameras, self.rates = cameras, History(len(cameras))
        if cameras:
            known = [self._rates[camera] for camera in cameras]
            rates = (rate if now_s - at_s < _SILENT_S else 0.0 for rate, at_s in known)
            self.rates.add(now_s - self._first_s, *rates)
