"""What the launcher knows of a run at this moment."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from schemas.map import MapSummary
from schemas.metrics import Quality
from schemas.sim import SceneSpec, SimClock
from schemas.status import ServiceStatus, TopicStatus
from services.launcher.processes import WATCHERS
from services.launcher.report import Record
from services.launcher.supervisor import Child

LAST_SCORE_S = 3.0
"""The run ends without the last score when it has not come by then (realtime may skip it)."""
SILENT_AFTER_S = 3.0
"""Heartbeats come each second; a service is silent when three are missing."""
# The stream by which a service is judged; the router has none.
_MAIN_STREAM = {
    "simulator": "sim/state",
    "planner": "formation",
    "mapper": "map/summary",
    "evaluator": "metrics/quality",
    "camera": "cams/{instance}/cloud",
}


@dataclass
class Board:
    """The newest of everything."""

    children: Mapping[str, Child]
    num_ticks: int | None
    record: Record
    statuses: dict[str, tuple[ServiceStatus, float]] = field(default_factory=dict)
    """By process: the last heartbeat and when it came, monotonic seconds."""
    clock: SimClock | None = None
    scene: SceneSpec | None = None
    summary: MapSummary | None = None
    quality: Quality | None = None
    finished_s: float | None = None
    """When the clock was first seen at its end, monotonic."""

    def add_status(self, status: ServiceStatus, now_s: float) -> None:
        """Take in a heartbeat."""
        address = f"{status.service}/{status.instance}"
        name = address if address in self.children else status.service
        self.statuses[name] = status, now_s
        self.record.add_status(status)

    @property
    def all_heard(self) -> bool:
        """Whether every service that has not failed has sent us a heartbeat: its link is made.

        Those that only watch are not waited for.
        """
        return all(
            name in self.statuses
            for name, child in self.children.items()
            if child.spec.service not in ("router", *WATCHERS) and child.state != "failed"
        )

    def health(self, name: str, now_s: float) -> str:
        """Return `up`, or what is wrong, in a word or two."""
        child = self.children[name]
        if child.state != "running":
            return {"waiting": "restarting", "failed": "given up"}.get(child.state, child.state)
        if child.spec.service == "router":
            return "up"
        if name not in self.statuses or self.statuses[name][0].pid != child.pid:
            return "starting"
        return "up" if now_s - self.statuses[name][1] < SILENT_AFTER_S else "silent"

    def main_stream(self, name: str) -> TopicStatus | None:
        """Return the stream by which a process is judged, as it reported it itself."""
        service, _, instance = name.partition("/")
        key = _MAIN_STREAM.get(service, "").format(instance=instance)
        if name not in self.statuses:
            return None
        streams = (topic for topic in self.statuses[name][0].topics if topic.sent)
        return next((topic for topic in streams if topic.key == key), None)

    @property
    def ticks_done(self) -> int:
        """Instants fused so far."""
        return 0 if self.summary is None else self.summary.tick + 1

    @property
    def finished(self) -> bool:
        """Whether the last instant has been fused and, with an evaluator at work, scored."""
        if self.num_ticks is None or self.ticks_done < self.num_ticks:
            return self.clock is not None and self.clock.state == "finished" and self._scored
        return self._scored

    @property
    def _over(self) -> bool:
        """Whether the clock has stood at its end for so long that no score is to be expected."""
        return self.finished_s is not None and time.monotonic() - self.finished_s > LAST_SCORE_S

    @property
    def _scored(self) -> bool:
        evaluator = self.children.get("evaluator")
        if evaluator is None or evaluator.state == "failed" or self._over:
            return True
        return self.quality is not None and self.quality.tick + 1 >= self.ticks_done

    def missing(self, now_s: float) -> str:
        """Say what the run is waiting for; empty when it flows."""
        unwell: dict[str, list[str]] = {}
        for name in self.children:
            if (health := self.health(name, now_s)) != "up":
                unwell.setdefault(health, []).append(name)
        if unwell:
            return "; ".join(f"{health}: {', '.join(who)}" for health, who in unwell.items())
        if self.clock is None:
            return "the simulator has not said anything yet"
        if self.clock.state == "waiting" and self.clock.waiting_for:
            return f"tick {self.clock.tick} waits for {', '.join(self.clock.waiting_for)}"
        if self.clock.dropped:
            return f"given up on: {', '.join(self.clock.dropped)}"
        return "" if self.summary is not None else "no instant has been fused yet"
