"""A remapped recording held against the recorded truth, instant by instant."""

import numpy as np

from schemas.camera import CameraInfo
from schemas.codec import decode
from schemas.map import MapChanges
from schemas.message import MessageError
from schemas.metrics import Quality
from schemas.sim import SimState
from schemas.topics import CAMERA_INFO, SIM_STATE, find
from services.evaluator.judge import Judge
from services.evaluator.settings import EvaluatorSettings
from services.launcher.errors import LauncherError
from services.recorder.log_file import RecordedLog
from services.runtime.map_mirror import MapMirror


class RemapScores:
    """Scores the map after every instant whose true state was recorded."""

    def __init__(self, log: RecordedLog, radius_m: float) -> None:
        """Read the truth.

        Raises:
            LauncherError: If none was recorded.
        """
        settings = EvaluatorSettings()
        self._judge = Judge(radius_m, settings.samples, settings.seed)
        self._states: dict[int, SimState] = {}
        self._cameras: dict[int, CameraInfo] = {}
        self._mirror = MapMirror()
        self.qualities: list[Quality] = []
        for record in log.records(wanted=lambda key: find(key) in (SIM_STATE, CAMERA_INFO)):
            topic = SIM_STATE if record.key == SIM_STATE.key else CAMERA_INFO
            try:
                message = decode(topic.adapter, record.payload)[1]
            except MessageError:
                continue
            if isinstance(message, SimState):
                self._states[message.tick] = message
            else:
                self._cameras[message.camera] = message
        if not self._states or not self._cameras:
            raise LauncherError(f"{log.path} has no truth: it lacks sim/state or cams/*/info")

    def add(self, changes: MapChanges) -> None:
        """Score what the map is after these changes."""
        self._mirror.apply(changes)
        state = self._states.get(changes.tick)
        if state is not None:
            centres_m = self._mirror.centres()
            self.qualities.append(
                self._judge.quality(changes, centres_m, state, state, self._cameras, 0)
            )

    def means(self) -> dict[str, float]:
        """Return the mean scores at the default tolerance's place in the table."""
        scores = [quality.stamp_true[1] for quality in self.qualities]
        names = ("precision", "coverage", "coverage_visible", "f_score")
        return {
            name: float(np.mean([getattr(score, name) for score in scores])) if scores else 0.0
            for name in names
        }
