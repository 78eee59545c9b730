"""Listens to a run and keeps the board."""

import time
from typing import Any, Self, TypeVar

from schemas.message import Message
from schemas.topics import (
    MAP_SUMMARY,
    QUALITY,
    SERVICE_STATUS,
    SIM_CLOCK,
    SIM_STATE,
    TARGET_ESTIMATE,
    TARGET_POSE,
)
from services.launcher.board import Board
from services.runtime.bus import Bus
from services.runtime.reader import Reader, Received

M = TypeVar("M", bound=Message)


class Watch:
    """Subscribes to what the board shows; no instant is passed over, however slow the screen."""

    def __init__(self, bus: Bus, board: Board) -> None:
        self._board = board
        self._summaries = bus.every(MAP_SUMMARY)
        self._qualities = bus.every(QUALITY)
        self._truths = bus.every(TARGET_POSE)
        self._estimates = bus.every(TARGET_ESTIMATE)
        self._clocks = bus.latest(SIM_CLOCK)
        self._states = bus.latest(SIM_STATE)
        self._statuses = bus.latest(SERVICE_STATUS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        readers: tuple[Reader[Any], ...] = (
            self._summaries,
            self._qualities,
            self._truths,
            self._estimates,
            self._clocks,
            self._states,
            self._statuses,
        )
        for reader in readers:
            reader.close()

    def update(self, timeout_s: float) -> None:
        """Take in all that has come; wait up to `timeout_s` for an instant if none has."""
        board = self._board
        for summary in _waiting(self._summaries, timeout_s):
            board.summary = summary.message
            board.record.add_summary(summary.message, summary.envelope.t_pub_ns)
        for quality in _waiting(self._qualities):
            board.quality = quality.message
            board.record.add_quality(quality.message)
        for truth in _waiting(self._truths):
            board.record.target.add_truth(truth.message)
        for estimate in _waiting(self._estimates):
            board.record.target.add_estimate(estimate.message)
        for clock in _waiting(self._clocks):
            board.clock = clock.message
            if clock.message.state == "finished" and board.finished_s is None:
                board.finished_s = time.monotonic()
        for state in _waiting(self._states):
            board.scene = state.message.scene
        for status in _waiting(self._statuses):
            board.add_status(status.message, time.monotonic())


def _waiting(reader: Reader[M], timeout_s: float = 0.0) -> list[Received[M]]:
    found: list[Received[M]] = []
    while True:
        try:
            found.append(reader.get(0.0 if found else timeout_s))
        except TimeoutError:
            return found
