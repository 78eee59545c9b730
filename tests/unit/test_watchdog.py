"""Who lives and says nothing for long is started anew; nobody else is."""

import os
import time

import pytest

from services.launcher import watchdog as module
from services.launcher.board import Board
from services.launcher.report import Record
from services.launcher.watchdog import FROZEN_AFTER_S, Watchdog
from tests.unit.test_board import child, status

pytestmark = pytest.mark.unit

REAL_CPU_S = module.cpu_s
NAMES = ("router", "simulator", "camera/0", "camera/1")


@pytest.fixture(autouse=True)
def idle(monkeypatch: pytest.MonkeyPatch) -> dict[int, float]:
    """Give what each process has used; as much as it said last, if it is not in here."""
    used: dict[int, float] = {}
    monkeypatch.setattr(module, "cpu_s", lambda pid: used.get(pid, 1.0))
    return used


def watched() -> tuple[Board, Watchdog]:
    board = Board({name: child(name, pid) for pid, name in enumerate(NAMES)}, None, Record(2))
    for pid, name in enumerate(NAMES[1:], 1):
        board.add_status(status(name, pid), 0.0)
    return board, Watchdog(board)


def look(board: Board, watchdog: Watchdog, until_s: float, *speaking: str) -> list[str]:
    """Look every second, as the launcher does; return who was ever found frozen."""
    found: list[str] = []
    for second in range(1, round(until_s) + 1):
        for name in speaking:
            board.add_status(status(name, NAMES.index(name)), float(second))
        found += [name for name in watchdog.frozen(float(second)) if name not in found]
    return found


def test_who_falls_silent_is_found_and_nobody_else() -> None:
    board, watchdog = watched()
    assert look(board, watchdog, FROZEN_AFTER_S - 1, "simulator", "camera/1") == []
    assert look(board, watchdog, FROZEN_AFTER_S + 3, "simulator", "camera/1") == ["camera/0"]


def test_one_that_is_starting_again_is_left_alone() -> None:
    board, watchdog = watched()
    board.children["camera/0"].process.pid = 77  # Another than has spoken.
    assert look(board, watchdog, 100, "simulator", "camera/1") == []


def test_one_that_is_no_longer_wanted_is_left_alone() -> None:
    board, watchdog = watched()
    board.children = {name: each for name, each in board.children.items() if name != "camera/0"}
    assert look(board, watchdog, 100, "simulator", "camera/1") == []


def test_a_launcher_that_stood_still_itself_blames_nobody() -> None:
    _, watchdog = watched()
    assert watchdog.frozen(1.0) == []
    assert watchdog.frozen(1000.0) == []
    assert watchdog.frozen(1001.0) == []


def test_one_that_is_at_work_is_left_alone_however_long_it_takes(idle: dict[int, float]) -> None:
    board, watchdog = watched()
    idle[NAMES.index("camera/0")] = 100.0
    assert look(board, watchdog, 60, "simulator", "camera/1") == []


def test_processor_time_is_the_kernels() -> None:
    before_s = time.process_time()
    while time.process_time() < before_s + 0.1:
        pass
    assert REAL_CPU_S(os.getpid()) == pytest.approx(time.process_time(), abs=0.05)
    assert REAL_CPU_S(2**22 + 1) == float("inf")
