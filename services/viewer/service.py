"""The viewer on the bus: everything in, a page for browsers out."""

import logging
import os
import time
from collections.abc import Callable
from typing import Any, TypeVar

from schemas.map import MapChanges, MapSummary
from schemas.message import Message
from schemas.status import ServiceStatus
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_COLOR,
    CAMERA_INFO,
    CAMERA_POSE,
    FORMATION,
    MAP_CHANGES,
    MAP_SUMMARY,
    QUALITY,
    SERVICE_STATUS,
    SIM_CLOCK,
    SIM_STATE,
    TARGET_ESTIMATE,
    TARGET_POSE,
    Topic,
)
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.loop import Loop
from services.runtime.map_follower import MapFollower
from services.runtime.reader import Received
from services.viewer.admission import Admission
from services.viewer.mishaps import Mishaps
from services.viewer.notices import Situation, notices, summary_line
from services.viewer.pictures import pictures
from services.viewer.settings import ViewerSettings
from services.viewer.steering_service import SteeringService
from services.viewer.studio import Studio
from services.viewer.voxels import ColourBy
from services.viewer.web import Panel, Web
from services.viewer.web_guard import WebGuard

logger = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)

_SERVICES = ("simulator", "camera", "planner", "mapper", "evaluator", "launcher", "replay")
_PANEL_PERIOD_S = 0.3
_RATES_PERIOD_S = 1.0
_NICENESS = 10


def give_way() -> None:
    """Let those who are watched go first; threads begun later do so too."""
    os.nice(_NICENESS)


class ViewerService:
    """Listens to little while nobody looks, to everything while somebody does.

    The loop's thread draws at most `rate_hz` frames per second from the newest of everything, and
    pauses for a whole period after each. Browsers are served by viser's thread, which keeps for
    each only the newest state of every handle: one that stops reading costs nobody anything.
    """

    def __init__(self, settings: ViewerSettings, bus: Bus, loop: Loop) -> None:
        token = settings.token.get_secret_value()
        admission = Admission(token, settings.host, insecure=settings.insecure)
        self._bus, self._loop = bus, loop
        self._router = settings.bus.connect
        self._instances: dict[str, set[str]] = {}
        self._alive: frozenset[str] = frozenset()
        self._stops: list[Callable[[], None]] = []
        self._studio, self._mishaps = Studio(), Mishaps()
        self._map = MapFollower(bus)
        self._since_s = self._panel_due_s = self._frame_s = 0.0
        self._num_frames = self._num_drawn = 0
        self._notices: list[str] = []
        self._steering = SteeringService(
            bus, lambda: self._alive, lambda: bool(self._stops), self._wants_full
        )
        self._guard = WebGuard(admission)
        self.web = Web(
            settings.host, settings.port, self._guard, settings.max_points, self._steering.ask,
            dark=settings.dark,
        )  # fmt: skip
        logger.info("open %s%s", self.web.url, "/?token=..." if admission.asks else "")
        self._listen(MAP_SUMMARY, self._on_summary)
        self._listen(QUALITY, lambda got: self._studio.plots.add_quality(got.message))
        self._listen(SERVICE_STATUS, self._on_status)
        for service in _SERVICES:
            loop.on_alive(service, self._presence_of(service))
        loop.serve("get", self._get)
        loop.every(1 / settings.rate_hz, self._draw)
        loop.every(_RATES_PERIOD_S, self._sample_rates)
        loop.at_end(self.close)
        self._steering.start()

    def close(self) -> None:
        """Ask and serve no more."""
        self._steering.stop()
        self.web.close()

    def _presence_of(self, service: str) -> Callable[[str, bool], None]:
        def on_alive(instance: str, up: bool) -> None:
            there = self._instances.setdefault(service, set())
            (there.add if up else there.discard)(instance)
            self._alive = frozenset(name for name, some in self._instances.items() if some)
            if service == "camera" and not up and instance.isdecimal():
                self._studio.newest.forget_camera(int(instance))

        return on_alive

    def _listen(
        self, topic: Topic[M], handler: Callable[[Received[M]], None]
    ) -> Callable[[], None]:
        def on(received: Received[M]) -> None:
            self._studio.newest.heard_s[topic.key] = time.monotonic()
            handler(received)

        return self._loop.on(topic, on)

    def _begin_to_watch(self) -> None:
        logger.info("somebody looks")
        self._since_s, self._panel_due_s = time.monotonic(), 0.0
        self._map = MapFollower(self._bus)
        self._steering.fetch_first()
        newest = self._studio.newest

        def keep(held: dict[int, Any]) -> Callable[[Received[Any]], None]:
            return lambda got: held.__setitem__(got.message.camera, got.message)

        def note(name: str) -> Callable[[Received[Any]], None]:
            return lambda got: setattr(newest, name, got.message)

        add_target = self._studio.add_target
        self._stops = [
            self._listen(CAMERA_INFO, keep(newest.infos)),
            self._listen(CAMERA_POSE, keep(newest.poses)),
            self._listen(CAMERA_CLOUD, keep(newest.clouds)),
            self._listen(CAMERA_COLOR, keep(newest.pictures)),
            self._listen(FORMATION, note("formation")),
            self._listen(SIM_CLOCK, note("clock")),
            self._listen(SIM_STATE, lambda got: self._studio.add_state(got.message)),
            self._listen(TARGET_POSE, lambda got: add_target(got.message)),
            self._listen(TARGET_ESTIMATE, lambda got: add_target(got.message)),
            self._listen(MAP_CHANGES, self._follow),
        ]

    def _follow(self, received: Received[MapChanges]) -> None:
        self._map.take(received)

    def _end_to_watch(self) -> None:
        logger.info("nobody looks any more")
        for stop in self._stops:
            stop()
        self._stops = []
        self._studio.let_go()

    def _draw(self) -> None:
        watched = self.web.num_browsers > 0
        if watched and not self._stops:
            self._begin_to_watch()
        elif not watched and self._stops:
            self._end_to_watch()
        if not watched:
            return
        began_s = time.monotonic()
        with self._loop.stage("draw"):
            self._draw_frame(began_s)
        self._frame_s = time.monotonic() - began_s
        self._num_frames += 1

    def _draw_frame(self, now_s: float) -> None:
        studio, options = self._studio, self.web.options()
        is_panel_due = now_s >= self._panel_due_s
        # A browser that is slow at decoding would be told to drop a picture before it is shown.
        images: dict[int, Any] = {}
        with self._mishaps.guarding("scene"):
            if self._map.mirror.latest is None and self._steering.first is not None:
                self._map.mirror.reset(self._steering.first)
            self._steering.first = None
            studio.update_map(self._map.mirror)
            full = self._steering.full
            if full is not None and options.colour_by is ColourBy.PROBABILITY:
                studio.voxels.learn(full)
            images = pictures(studio.newest) if is_panel_due else {}
            frame = studio.frame(options, images)
            self._num_drawn = 0 if frame.voxels is None else len(frame.voxels.positions_m)
            self.web.draw(frame)
        if is_panel_due:
            self._panel_due_s = now_s + _PANEL_PERIOD_S
            with self._mishaps.guarding("panel"):
                self.web.draw_panel(self._panel(now_s, images))

    def _panel(self, now_s: float, images: dict[int, Any]) -> Panel:
        studio = self._studio
        held = studio.voxels.held
        situation = Situation(
            now_s=now_s,
            since_s=self._since_s,
            router=self._router,
            alive=self._alive,
            newest=studio.newest,
            num_occupied=None if held is None else len(studio.voxels),
            num_drawn=self._num_drawn if self._num_drawn else len(studio.voxels),
            refusals=studio.refusals,
        )
        self._notices = notices(situation)
        if studio.world_error:
            self._notices.append(f"The truth cannot be shown: {studio.world_error}")
        self._notices += self._mishaps.lines
        if trouble := self._steering.reports.get("launcher", {}).get("trouble"):
            self._notices.append(str(trouble))
        line = summary_line(situation)
        return Panel(self._steering.reports, line, self._notices, studio.plots, images)

    def _wants_full(self) -> bool:
        return bool(self._stops) and self.web.options().colour_by is ColourBy.PROBABILITY

    def _on_summary(self, received: Received[MapSummary]) -> None:
        self._studio.newest.summary = received.message
        self._studio.plots.add_summary(received.message)

    def _on_status(self, received: Received[ServiceStatus]) -> None:
        self._studio.add_status(received.message, time.monotonic())

    def _sample_rates(self) -> None:
        self._studio.plots.sample_rates(time.monotonic())

    def _get(self, params: dict[str, Any]) -> dict[str, Any]:
        """Tell where the page is and what it shows."""
        only(params)
        return {
            "url": self.web.url,
            "port": self.web.port,
            "refused": self._guard.num_refused,
            "browsers": self.web.num_browsers,
            "frames": self._num_frames,
            "frames_failed": self._mishaps.num_failed,
            "frame_ms": 1000 * self._frame_s,
            "voxels": len(self._studio.voxels),
            "voxels_drawn": self._num_drawn,
            "colour_by": self.web.options().colour_by.value,
            "notices": self._notices if self._stops else [],
            "reports": self._steering.reports if self._stops else {},
        }
