"""Keeps the processes of a run alive, and leaves none behind."""

import contextlib
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Literal, Self

from services.launcher.processes import ProcessSpec

logger = logging.getLogger(__name__)

TERMINATE_TIMEOUT_S = 2.0
_PATIENCE_S = {"recorder": 20.0}
"""Of those that have something to finish: a long recording's last samples and its summary."""
_CHILD_SCRIPT = Path(__file__).with_name("child.py")
_POLL_S = 0.01
_NEVER_AGAIN = 2
"""Exit code of a service whose settings are wrong: starting it again cannot mend it."""

State = Literal["running", "waiting", "failed", "stopped", "ending"]


@dataclass(frozen=True)
class RestartPolicy:
    """How often, and how soon, what crashes is started again."""

    first_delay_s: float = 0.1
    """Tripled with each crash in a row."""
    max_delay_s: float = 8.0
    max_in_a_row: int = 5
    """Crashes in a row after which a process is given up."""
    steady_after_s: float = 30.0
    """A process that lived this long starts a new row."""

    def delay_s(self, crashes_in_a_row: int) -> float:
        """Return the pause before the next start."""
        return min(self.first_delay_s * 3.0 ** (crashes_in_a_row - 1), self.max_delay_s)


@dataclass(frozen=True)
class Crash:
    """A process ended that should not have."""

    name: str
    exit_code: int
    """Negative: the signal that killed it."""
    log_tail: str
    given_up: bool

    def __str__(self) -> str:
        how = f"signal {-self.exit_code}" if self.exit_code < 0 else f"exit code {self.exit_code}"
        then = "given up" if self.given_up else "starting it again"
        return f"{self.name} ended with {how}; {then}"


@dataclass
class Child:
    """One process and its history."""

    spec: ProcessSpec
    state: State = "stopped"
    restarts: int = 0
    crashes_in_a_row: int = 0
    started_s: float = 0.0
    restart_at_s: float = 0.0
    kill_at_s: float = 0.0
    process: subprocess.Popen[bytes] | None = field(default=None, repr=False)

    @property
    def pid(self) -> int | None:
        """Process id while it runs."""
        return self.process.pid if self.process is not None and self.state == "running" else None

    @property
    def patience_s(self) -> float:
        """How long it may take to end once it is asked to."""
        return _PATIENCE_S.get(self.spec.service, TERMINATE_TIMEOUT_S)


class Supervisor:
    """Starts processes, watches them, ends them.

    Each child leads its own process group, so that Ctrl-C at the terminal reaches the launcher
    alone, and dies with the launcher even if that is killed. All methods belong to one thread,
    the one that lives longest: Linux ties a child's life to the thread that started it.
    """

    def __init__(
        self,
        specs: Sequence[ProcessSpec],
        logs: Path,
        policy: RestartPolicy | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.children = {spec.name: Child(spec) for spec in specs}
        self._logs = logs
        self._policy = policy or RestartPolicy()
        self._ended_restarts = 0
        self._environment = dict(os.environ if environment is None else environment)

    def __enter__(self) -> Self:
        self._logs.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def restarts(self) -> int:
        """How many times any child was started again."""
        return self._ended_restarts + sum(each.restarts for each in self.children.values())

    def start(self, *names: str) -> None:
        """Start the named children, or all that have not been started."""
        for child in [self.children[name] for name in names] or self.children.values():
            if child.state == "stopped":
                self._launch(child)

    def add(self, spec: ProcessSpec) -> None:
        """Start one more."""
        self.children[spec.name] = Child(spec)
        self.start(spec.name)

    def end(self, name: str) -> None:
        """Ask a child to end; it is forgotten when a `poll` finds that it has."""
        child = self.children[name]
        if child.state == "running":
            _signal_group(child, signal.SIGTERM)
            child.kill_at_s = time.monotonic() + child.patience_s
        child.state = "ending"

    def kill(self, name: str) -> None:
        """End a child at once; the next `poll` finds that it crashed, and starts it again."""
        _signal_group(self.children[name], signal.SIGKILL)

    def poll(self) -> list[Crash]:
        """Notice what ended, start again what is due; return the crashes since the last call."""
        now_s, crashes = time.monotonic(), []
        for child in list(self.children.values()):
            if child.state == "ending":
                self._go_on_ending(child, now_s)
            elif child.state == "running" and child.process is not None:
                code = child.process.poll()
                if code is not None:
                    crashes.extend(self._ended(child, code, now_s))
            elif child.state == "waiting" and now_s >= child.restart_at_s:
                child.restarts += 1
                self._launch(child)
        return crashes

    def log_path(self, name: str) -> Path:
        """Return the file that holds a child's output."""
        return self._logs / f"{self.children[name].spec.log_name}.log"

    def stop(self) -> None:
        """End all children: SIGTERM, then SIGKILL to each group that outlasts our patience."""
        alive = [each for each in self.children.values() if each.state in ("running", "ending")]
        for child in alive:
            _signal_group(child, signal.SIGTERM)
        asked_s = time.monotonic()
        for child in sorted(alive, key=lambda each: each.patience_s):
            while _runs(child) and time.monotonic() < asked_s + child.patience_s:
                time.sleep(_POLL_S)
            if _runs(child):
                logger.warning("%s did not stop within %g s", child.spec.name, child.patience_s)
            _signal_group(child, signal.SIGKILL)  # Also what the child itself has started.
            if child.process is not None:
                child.process.wait()
        for child in self.children.values():
            child.state = "stopped"

    def _launch(self, child: Child) -> None:
        with self._open_log(child.spec.name) as log:
            # `child.py` asks the kernel for our death's signal and becomes the service. A function
            # run between fork and exec would do so too, but is unsafe beside zenoh's threads.
            child.process = subprocess.Popen(
                [
                    sys.executable,
                    "-I",
                    "-S",
                    str(_CHILD_SCRIPT),
                    str(os.getpid()),
                    *child.spec.argv,
                ],
                env=self._environment | dict(child.spec.env),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
        child.state = "running"
        child.started_s = time.monotonic()

    def _go_on_ending(self, child: Child, now_s: float) -> None:
        if not _runs(child):
            _signal_group(child, signal.SIGKILL)  # Also what it has started itself.
            self._ended_restarts += child.restarts
            del self.children[child.spec.name]
        elif now_s >= child.kill_at_s:
            _signal_group(child, signal.SIGKILL)

    def _ended(self, child: Child, code: int, now_s: float) -> list[Crash]:
        _signal_group(child, signal.SIGKILL)
        # Services end only when they are told to: whatever ends by itself, well or not, is missed.
        steady = now_s - child.started_s >= self._policy.steady_after_s
        child.crashes_in_a_row = 1 if steady else child.crashes_in_a_row + 1
        given_up = code == _NEVER_AGAIN or child.crashes_in_a_row > self._policy.max_in_a_row
        child.state = "failed" if given_up else "waiting"
        child.restart_at_s = now_s + self._policy.delay_s(child.crashes_in_a_row)
        return [Crash(child.spec.name, code, tail(self.log_path(child.spec.name)), given_up)]

    def _open_log(self, name: str) -> IO[bytes]:
        return self.log_path(name).open("ab")


def tail(path: Path, num_lines: int = 12) -> str:
    """Return the last lines of a log."""
    try:
        with path.open("rb") as log:
            log.seek(max(0, path.stat().st_size - 16384))
            text = log.read().decode(errors="replace")
    except OSError:
        return ""
    return "\n".join(text.splitlines()[-num_lines:])


def _runs(child: Child) -> bool:
    return child.process is not None and child.process.poll() is None


def _signal_group(child: Child, number: signal.Signals) -> None:
    if child.process is None:
        return
    # The group may be gone; macOS says so with a permission error.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child.process.pid, number)
