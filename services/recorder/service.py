"""The recorder on the bus: takes in what is said and keeps it, whatever becomes of itself."""

import json
import logging
import threading
import time
from typing import Any

from schemas.topics import MAP_FULL, Delivery, find
from services.recorder.log_writer import MAX_KEYS, LogWriter, as_metadata
from services.recorder.settings import RecorderSettings
from services.recorder.steady_clock import steady_clock
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.errors import NoReply
from services.runtime.key_filter import KeyFilter
from services.runtime.loop import Loop
from services.runtime.meter import MAX_KEY_LENGTH
from services.runtime.tap import Sample, Tap

logger = logging.getLogger(__name__)

FLUSH_S = 0.5
"""What is older than this is the operating system's: a kill loses no more."""
_SNAPSHOT_TIMEOUT_S = 2.0
_NO_MAPPER_S = 1.0  # Pause before a mapper that does not answer is asked again.
_SNAPSHOT_SHARE = 0.05  # Of the time, at most, goes into snapshots, however large the map.
_FULL_DISK_S = 0.25  # Pause before a disk that took nothing is tried again.
_LAST_WORDS_S = 8.0  # For what still waits at the end; the supervisor waits 20 s for us.
_SILENCE_S = 3.0  # After which one begins to wonder.
_OURS = ("metrics/recorder", "metrics/replay")
"""Of no meaning in a replay, which says its own."""


class RecorderService:
    """Writes on a thread of its own, so that requests and heartbeats never wait for the disk.

    A full disk stops the writing, not the service: what waits is bounded, what is dropped is
    counted, and as soon as there is room the recording goes on where it stopped.
    """

    def __init__(self, settings: RecorderSettings, bus: Bus, loop: Loop) -> None:
        self._settings, self._bus, self._loop = settings, bus, loop
        told = settings.model_dump(mode="json", exclude={"bus", "about"})
        about = {"recorder": json.dumps(told), "run": settings.about}
        self._log = LogWriter(settings.path(), as_metadata(about), overwrite=settings.overwrite)
        expressions = settings.expressions()
        self._clock = steady_clock()
        self._tap = Tap(bus, expressions, settings.queue_mib << 20, self._clock)
        self._stopping = threading.Event()
        self._began_s = time.monotonic()
        self._held_up = ""
        self._num_unkept = 0
        self._writer = threading.Thread(target=self._run, name="writer", daemon=True)
        self._writer.start()
        if KeyFilter(expressions)(MAP_FULL.key) or not settings.keys:
            threading.Thread(target=self._take_snapshots, name="snapshots", daemon=True).start()
        loop.serve("get", self._get)
        loop.after(_SILENCE_S, self._complain)
        loop.at_end(self._end)
        logger.info("recording %s into %s", ", ".join(expressions), self._log.path)

    def _run(self) -> None:
        try:
            self._write()
        finally:
            self._loop.stop()  # A service that records nothing must not go on as if it did.

    def _write(self) -> None:
        flush_s = time.monotonic() + FLUSH_S
        while not self._finished():
            self._notice(self._log.held_up)
            if self._held_up:
                self._stopping.wait(_FULL_DISK_S)
                if self._stopping.is_set():
                    return
                continue
            try:
                sample = self._tap.get(max(0.0, flush_s - time.monotonic()))
            except TimeoutError:
                pass
            else:
                self._keep(sample)
            if time.monotonic() >= flush_s:
                self._log.flush()
                flush_s = time.monotonic() + FLUSH_S

    def _finished(self) -> bool:
        return self._stopping.is_set() and not self._tap.waiting_bytes

    def _keep(self, sample: Sample) -> None:
        if sample.key in _OURS:
            return
        if not self._log.takes(sample.key):
            if not self._num_unkept:
                logger.warning(
                    "%.80r is not recorded, nor are others like it: a key has at most %d "
                    "characters, a recording at most %d keys",
                    sample.key, MAX_KEY_LENGTH, MAX_KEYS,
                )  # fmt: skip
            self._num_unkept += 1
            return
        envelope = self._log.write(sample)
        topic = find(sample.key)
        meter = self._bus.meters.of(topic, sample.key, sent=False)
        meter.tick(time.monotonic())
        # Answers are numbered over all who ask: what we did not ask for is no loss of ours.
        if envelope is not None and (topic is None or topic.delivery is not Delivery.QUERY):
            meter.follow(envelope)

    def _notice(self, held_up: str) -> None:
        if held_up and not self._held_up:
            logger.error("%s takes no more: %s; waiting for room", self._log.path, held_up)
        elif self._held_up and not held_up:
            num = sum(self._tap.dropped.values())
            logger.warning("%s: going on; %d samples dropped so far", self._log.path, num)
        self._held_up = held_up

    def _take_snapshots(self) -> None:
        pause_s = 0.0
        while not self._stopping.wait(pause_s):
            began_s = time.monotonic()
            try:
                payload = self._bus.fetch_bytes(MAP_FULL.key, _SNAPSHOT_TIMEOUT_S)
            except NoReply:
                pause_s = _NO_MAPPER_S
                continue
            self._tap.add(Sample(MAP_FULL.key, payload, self._clock(), None))
            took_s = time.monotonic() - began_s
            pause_s = max(self._settings.snapshot_every_s, took_s / _SNAPSHOT_SHARE)

    def _complain(self) -> None:
        if not self._log.num_records:
            logger.warning(
                "nothing heard yet by way of %s: does anybody say it? `encircle list` tells",
                self._settings.bus.connect or "no router",
            )

    def _get(self, params: dict[str, Any]) -> dict[str, Any]:
        only(params)
        return {
            "file": str(self._log.path),
            "seconds": time.monotonic() - self._began_s,
            "records": self._log.num_records,
            "bytes": self._log.num_bytes,
            "waiting_bytes": self._tap.waiting_bytes,
            "dropped": self._tap.dropped,
            "lost": self._lost(),
            "unkept": self._num_unkept,
            "held_up": self._held_up,
        }

    def _lost(self) -> dict[str, int]:
        """Return how many samples never came, or were dropped, by their senders' numbering."""
        return {meter.key: meter.lost for meter in self._bus.meters if meter.lost}

    def _end(self) -> None:
        self._tap.close()  # First: the writer ends when nothing waits, and nothing may come then.
        self._stopping.set()
        self._writer.join(_LAST_WORDS_S)
        late = self._writer.is_alive()
        if late:
            # The writer still has the file: what is on the disk is readable as it is.
            logger.error("%s lacks its last samples: the disk is too slow", self._log.path)
            raise SystemExit(1)
        dropped = self._tap.dropped
        left = self._log.close(
            as_metadata(
                {
                    "records": self._log.num_records,
                    "dropped": dropped,
                    "lost": self._lost(),
                    "unkept": self._num_unkept,
                    "ended_ns": time.time_ns(),
                }
            )
        )
        num_dropped, mb = sum(dropped.values()), self._log.num_bytes / 1e6
        logger.info(
            "%d samples, %.1f MB, %d dropped: %s",
            self._log.num_records, mb, num_dropped, self._log.path,
        )  # fmt: skip
        if left or self._tap.waiting_bytes:
            logger.error("%s lacks its end: %s", self._log.path, self._held_up or "no room")
            raise SystemExit(1)
