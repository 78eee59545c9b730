"""The replay on the bus: says again what was recorded, and answers for the map of then."""

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from schemas.codec import encode
from schemas.map import MapFull
from schemas.topics import MAP_CHANGES, MAP_FULL
from services.recorder.errors import BadRecording, RecorderError
from services.recorder.history import MAP_KEYS, History, take
from services.recorder.live_senders import LiveSenders
from services.recorder.log_file import Record, RecordedLog
from services.recorder.map_state import MapState
from services.recorder.playback import Playback
from services.recorder.settings import ReplaySettings
from services.runtime.bus import Bus
from services.runtime.command import only
from services.runtime.errors import SettingsRefused
from services.runtime.key_filter import KeyFilter
from services.runtime.loop import Loop, Timer
from services.runtime.service import main as serve

logger = logging.getLogger(__name__)

_AT_ONCE_S = 0.01  # Between two looks at what is asked.
_BREATH_S = 0.001
_LINGER_S = 0.5  # What was said last is still being fetched from our shared memory.
_TOOLS = ("metrics/recorder", "metrics/replay")
"""Of the tools themselves; this replay has its own."""


class _Set(BaseModel):
    model_config = ConfigDict(extra="forbid")

    rate: Annotated[float, Field(gt=0, le=1000)] | None = None
    loop: bool | None = None


class _Seek(BaseModel):
    model_config = ConfigDict(extra="forbid")

    t_s: float


class ReplayService:
    """Says every record at its time; requests steer it as a tape is steered."""

    def __init__(self, settings: ReplaySettings, bus: Bus, loop: Loop) -> None:
        self._settings, self._bus, self._loop = settings, bus, loop
        self._log = _open(settings.file)
        self._keys = _keys_of(self._log, KeyFilter(settings.keys or ("**",)))
        self._live = LiveSenders(bus, self._keys)
        self._skipped: set[str] = set()
        self._playback = Playback(self._log, self._is_wanted, settings.rate, loop=settings.loop)
        self._playback.seek(settings.start, 0.0)  # Refused now, if it is out of reach.
        self._history = History(self._log, self._is_wanted)
        self._map = MapState()
        self._timer: Timer | None = None
        self._stop: Timer | None = None  # Our end, unless somebody steers us on.
        self._num_said = self._num_unread = 0
        for key in self._keys:
            if key != MAP_FULL.key:
                bus.prepare(key)
        if not set(MAP_KEYS).isdisjoint(self._keys):
            loop.answer(MAP_FULL, self._full)
        loop.at_end(self._log.close)
        loop.after(settings.delay_s, self._begin)

    def _begin(self) -> None:
        silent, said_live = self._live.close()
        if said_live and not self._settings.force:
            raise SettingsRefused(
                f"{', '.join(said_live[:3])}{' ...' if len(said_live) > 3 else ''} said live on "
                "this bus: stop whoever says it, or replay beside it with --prefix NAME, or choose "
                "other --keys; --force replays all the same"
            )
        self._skipped = silent
        for sentence in self._log.lost:
            logger.warning("%s: %s", self._log.path, sentence)
        logger.info(
            "%s: %.1f s, %d samples of %d keys, %gx",
            self._log.path, self._playback.duration_s, len(self._log), len(self._keys),
            self._playback.rate,
        )  # fmt: skip
        self._playback.seek(0.0, time.monotonic())
        for verb, handler in {
            "pause": self._pause,
            "resume": self._resume,
            "seek": self._seek,
            "set": self._set,
            "get": self._get,
        }.items():
            self._loop.serve(verb, handler)
        if self._settings.start:
            self._go_to(self._settings.start)
        if not self._settings.paused:
            self._playback.resume(time.monotonic())
        self._play()

    # What is said.

    def _play(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        until_s = time.monotonic() + _AT_ONCE_S
        while (now_s := time.monotonic()) < until_s:
            record = self._playback.take(now_s)
            if record is None:
                break
            self._say(record)
        if self._playback.ended:
            self._end()
        elif (wait_s := self._playback.wait_s(time.monotonic())) is not None:
            self._timer = self._loop.after(max(wait_s, _BREATH_S), self._play)

    def _say(self, record: Record) -> None:
        if record.key in MAP_KEYS:
            take(self._map, record)
        if record.key != MAP_FULL.key:  # That one is said to those who ask.
            said = self._bus.republish(record.key, record.payload)
            self._num_said += said
            self._num_unread += not said

    def _end(self) -> None:
        if self._playback.paused:
            return
        if self._playback.loop:
            self._playback.seek(0.0, time.monotonic())
            self._tell_map()
            self._timer = self._loop.after(_BREATH_S, self._play)
            return
        self._playback.pause(time.monotonic())
        num = (self._num_said, self._num_unread)
        logger.info("the end of %s: %d samples said, %d unread", self._log.path, *num)
        if not self._settings.hold:
            self._stop = self._loop.after(_LINGER_S, self._loop.stop)

    def _stay(self) -> bool:
        """Do not end, though all was said; whether we were about to."""
        stop, self._stop = self._stop, None
        if stop is not None:
            stop.cancel()
        return stop is not None

    def _go_to(self, t_s: float) -> None:
        """Leap, and say what whoever looks on would know by now."""
        self._playback.seek(t_s, time.monotonic())
        at_ns = self._log.start_ns + round(t_s * 1e9)
        for record in self._history.last_words(at_ns):
            self._say(record)
        self._tell_map(at_ns)

    def _tell_map(self, at_ns: int | None = None) -> None:
        """Say the map whole: those who follow the changes have another time's.

        The recorded numbers go on from there, so nobody takes it for another mapper's.
        """
        self._history.map_at(self._log.start_ns if at_ns is None else at_ns, self._map)
        changes, envelope = self._map.anew(), self._map.envelope
        if changes is None or envelope is None or MAP_CHANGES.key not in self._keys:
            return
        fresh = envelope.model_copy(update={"t_pub_ns": time.time_ns()})
        self._bus.republish(MAP_CHANGES.key, encode(changes, fresh).join())

    def _full(self) -> MapFull | None:
        return self._map.full()

    def _is_wanted(self, key: str) -> bool:
        return key in self._keys and key not in self._skipped

    # What is asked.

    def _pause(self, params: dict[str, Any]) -> dict[str, Any]:
        only(params)
        self._playback.pause(time.monotonic())
        return self._get({})

    def _resume(self, params: dict[str, Any]) -> dict[str, Any]:
        only(params)
        self._stay()
        if self._playback.ended:
            self._playback.seek(0.0, time.monotonic())
            self._tell_map()
        self._playback.resume(time.monotonic())
        self._play()
        return self._get({})

    def _seek(self, params: dict[str, Any]) -> dict[str, Any]:
        self._go_to(_Seek.model_validate(params).t_s)
        self._stay()
        self._play()
        return self._get({})

    def _set(self, params: dict[str, Any]) -> dict[str, Any]:
        wanted = _Set.model_validate(params)
        if wanted.rate is not None:
            self._playback.set_rate(wanted.rate, time.monotonic())
        if wanted.loop is not None:
            self._playback.loop = wanted.loop
        if wanted.loop and self._stay():
            return self._resume({})  # A loop has no end: it begins anew.
        self._play()
        return self._get({})

    def _get(self, params: dict[str, Any]) -> dict[str, Any]:
        only(params)
        playback = self._playback
        return {
            "file": str(self._log.path),
            "state": "ended" if playback.ended else "paused" if playback.paused else "playing",
            "position_s": playback.position_s(time.monotonic()),
            "duration_s": playback.duration_s,
            "rate": playback.rate,
            "loop": playback.loop,
            "began_ns": self._log.start_ns,
            "said": self._num_said,
            "unread": self._num_unread,
            "keys": sorted(self._keys),
            "skipped": sorted(self._skipped),
            "lost": self._log.lost,
        }


def main(args: Sequence[str] | None = None) -> None:
    """Replay until the end, SIGINT or SIGTERM."""
    serve(ReplaySettings, "replay", ReplayService, args)


def _open(file: Path | None) -> RecordedLog:
    if file is None:
        raise RecorderError("name a recording, e.g. `encircle replay out.mcap`")
    try:
        return RecordedLog(file)
    except OSError as error:
        raise BadRecording(f"{file} cannot be read: {error.strerror}") from None


def _keys_of(log: RecordedLog, wanted: KeyFilter) -> set[str]:
    keys = {key for key in log.channels if wanted(key) and key not in _TOOLS}
    if not keys:
        known = ", ".join(sorted(log.channels)) or "nothing"
        raise RecorderError(f"{log.path} has no such key; it has {known}")
    return keys
