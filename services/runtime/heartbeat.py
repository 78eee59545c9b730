"""What a service says of itself once a second."""

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from schemas.status import ServiceStatus
from schemas.topics import SERVICE_STATUS
from services.runtime.bus import Bus
from services.runtime.meter import StageMeter

PERIOD_S = 1.0
EARLY_S = (0.2, 0.5)
"""A new service is shown before its first period is over."""
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


class Heartbeat:
    """Publishes `metrics/<service>[/<i>]`."""

    def __init__(self, bus: Bus, stages: StageMeter) -> None:
        self._bus = bus
        self._stages = stages
        self._start_s = time.monotonic()
        self._version = installed_version()

    def status(self) -> ServiceStatus:
        """Derive the service's health from its streams and stages."""
        now_s = time.monotonic()
        service, _, instance = self._bus.address.partition("/")
        topics = tuple(meter.status(now_s) for meter in self._bus.meters)
        return ServiceStatus(
            t_ns=time.time_ns(),
            tick=0,
            frame_id="none",
            service=service,
            instance=instance or "0",
            version=self._version,
            host=platform.node(),
            pid=os.getpid(),
            uptime_s=now_s - self._start_s,
            cpu_s=time.process_time(),
            rss_bytes=int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_BYTES,
            shm_used=self._bus.pool.in_use,
            bad_messages=sum(topic.bad for topic in topics),
            bad_reason=self._bus.last_refusal,
            topics=topics[:512],
            stages=self._stages.status()[:64],
        )

    def publish(self) -> None:
        """Send one heartbeat."""
        self._bus.publish(SERVICE_STATUS, self.status(), service=self._bus.address)


def installed_version() -> str:
    """Return the version of encircle that is installed here; empty when it runs uninstalled."""
    try:
        return version("encircle")
    except PackageNotFoundError:
        return ""
