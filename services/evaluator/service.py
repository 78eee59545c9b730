"""The evaluator on the bus: the map and the truth in, metrics/quality out."""

import logging
from typing import Any

from schemas.camera import CameraInfo
from schemas.map import MapChanges, MapSummary
from schemas.metrics import Quality
from schemas.sim import SceneSpec, SimState
from schemas.topics import CAMERA_INFO, MAP_CHANGES, MAP_SUMMARY, QUALITY, SIM_STATE
from services.evaluator.history import History
from services.evaluator.judge import Judge
from services.evaluator.open3d_loader import open3d
from services.evaluator.settings import EvaluatorSettings
from services.runtime.bus import Bus
from services.runtime.later import Later
from services.runtime.loop import Loop
from services.runtime.map_follower import MapFollower
from services.runtime.reader import Received
from services.world.errors import WorldError
from services.world.scene import scene_of

logger = logging.getLogger(__name__)

_MOST_BEHIND_TICKS = 2


class EvaluatorService:
    """Scores the newest fused instant as soon as all that it needs has come.

    That is the summary that closes the instant, the mirror at its revision, the true state at
    its tick, and the optics of the cameras that were fused. These come on different keys, in any
    order, so whichever comes last sets off the scoring. A newer summary takes the place of one
    that still waits, which is then counted as skipped, as one is that came too late in realtime.
    In lockstep that does not happen: the simulator lets the evaluator be one tick late at most.
    """

    def __init__(self, settings: EvaluatorSettings, bus: Bus, loop: Loop) -> None:
        open3d()  # Slow, and possibly missing: before the first instant, not at it.
        self._bus = bus
        self._loop = loop
        self._judge = Judge(settings.radius_m, settings.samples, settings.seed)
        self._history = History()
        self._cameras: dict[int, CameraInfo] = {}
        self._map = MapFollower(bus)
        self._waiting: MapSummary | None = None
        self._scored_rev: int | None = None
        self._skipped = 0
        self._refused: SceneSpec | None = None
        self._told: Quality | None = None
        loop.serve_later("prepare", self._prepare)
        loop.on(SIM_STATE, self._on_state, every=True)
        loop.on(CAMERA_INFO, self._on_info)
        loop.on(MAP_CHANGES, self._on_changes)
        loop.on(MAP_SUMMARY, self._on_summary, every=True)

    def _on_state(self, received: Received[SimState]) -> None:
        state = received.message
        if state.scene == self._refused:
            return
        try:
            self._judge.truth(state.scene)  # Slow for a scene that nobody made ready.
        except WorldError as error:
            self._refused = state.scene
            logger.error("cannot score scene %s: %s", state.scene.object, error)
            return
        if self._told is not None and self._told.tick == state.tick:
            self._bus.publish(QUALITY, self._told)  # Asked again: what we said was lost.
        self._history.add(state)
        self._score()

    def _prepare(self, params: dict[str, Any]) -> Later[object]:
        """Build the truth of the scene that is about to come, beside the scoring."""
        scene = scene_of(params)
        return Later(lambda: self._judge.truth(scene), lambda _: {"object": scene.object})

    def _on_info(self, received: Received[CameraInfo]) -> None:
        self._cameras[received.message.camera] = received.message
        self._score()

    def _on_changes(self, received: Received[MapChanges]) -> None:
        self._follow(received.envelope.boot)
        with self._loop.stage("mirror"):
            self._map.take(received)
        self._score()

    def _on_summary(self, received: Received[MapSummary]) -> None:
        self._follow(received.envelope.boot)
        newest = self._history.newest
        behind = 0 if newest is None else newest.tick - received.message.tick
        if newest is not None and newest.mode == "realtime" and behind > _MOST_BEHIND_TICKS:
            return  # Too slow to score all: a newer is on its way. Lockstep waits for us.
        self._waiting = received.message
        self._score()

    def _follow(self, boot: str) -> None:
        """Begin anew when the mapper is another process than before."""
        if self._map.know(boot):
            self._scored_rev, self._waiting = None, None

    def _score(self) -> None:
        summary, held = self._waiting, self._map.mirror.latest
        if summary is None or held is None or held.rev < summary.rev:
            return
        stamp, newest = self._history.at(held.tick), self._history.newest
        if stamp is None or newest is None or not set(summary.cameras_used) <= set(self._cameras):
            return
        self._waiting = None
        if self._scored_rev is not None:
            if held.rev <= self._scored_rev:
                return
            self._skipped += held.rev - self._scored_rev - 1
        self._scored_rev = held.rev
        with self._loop.stage("score"):
            self._told = self._judge.quality(
                held, self._map.mirror.centres(), stamp, newest, self._cameras, self._skipped
            )
        self._bus.publish(QUALITY, self._told)
