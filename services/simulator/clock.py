"""The simulation's clock: when it may start, when it may go on, when it is done."""

from collections.abc import Collection
from typing import Literal

from schemas.sim import SimMode
from services.simulator.lockstep import Barrier, in_order

_ONLOOKERS = {"launcher"}  # The start waits for their links, no tick waits for their answer.
_MOST_LATE_TICKS = 15
"""A camera that comes while time is real is placed at a goal that is no older."""
State = Literal["waiting", "running", "paused", "finished"]


class Clock:
    """Counts ticks. In lockstep a tick ends when all have acknowledged it, else when it is due."""

    def __init__(self, lockstep: bool, expected: Collection[str], num_ticks: int | None) -> None:
        self.lockstep = lockstep
        self.mode: SimMode = "lockstep" if lockstep else "realtime"
        self.tick = 0
        self._expected = frozenset(expected)
        self._num_ticks = num_ticks
        self._barrier = Barrier()
        self._present: set[str] = set()
        self._started = self._paused = self._finished = False
        self._steps_left = 0

    @property
    def state(self) -> State:
        """What the clock is doing."""
        if self._finished:
            return "finished"
        if not self._started:
            return "waiting"
        return "paused" if self._paused else "running"

    @property
    def is_last_tick(self) -> bool:
        """Whether there is nothing after the current tick."""
        return self._num_ticks is not None and self.tick + 1 >= self._num_ticks

    @property
    def dropped(self) -> tuple[str, ...]:
        """Who was given up on and has not come back."""
        return self._barrier.dropped

    def expect(self, expected: Collection[str]) -> None:
        """Wait for others at the start; who is not expected any more is let go."""
        for name in self._expected - frozenset(expected):
            self._barrier.leave(name)
        self._expected = frozenset(expected)

    @property
    def present(self) -> frozenset[str]:
        """Who is on the bus."""
        return frozenset(self._present)

    def appear(self, name: str) -> None:
        """Note that `name` is on the bus; once the clock runs, it joins by acknowledging."""
        self._present.add(name)

    def vanish(self, name: str) -> None:
        """Note that `name` has left the bus."""
        self._present.discard(name)
        self._barrier.leave(name)

    def waiting_for(self, placed: Collection[str]) -> tuple[str, ...]:
        """Return who holds the clock up.

        Args:
            placed: the cameras that are in the world; before the start others are waited for.
        """
        if self._started:
            runs = self._finished or not self.lockstep
            return () if runs else self.missing() or self._absent_cameras()
        ready = {n for n in self._present if n in placed or not n.startswith("camera/")}
        return in_order(self._expected - ready)

    def _absent_cameras(self) -> tuple[str, ...]:
        cameras = (name for name in self._expected if name.startswith("camera/"))
        return in_order(cameras) if self.lacks_cameras() else ()

    def admits(self, camera: str, tick: int) -> bool:
        """Whether a goal of `tick` may bring a camera into the world.

        Before the start that of tick 0 does: what is under way from before a reset must place
        nobody. Later a camera has to be there itself, as its place alone sees nothing.
        """
        if not self._started:
            return tick == 0
        late = self.tick - tick
        return camera in self._present and 0 <= late <= (0 if self.lockstep else _MOST_LATE_TICKS)

    def start(self, placed: Collection[str]) -> bool:
        """Start if nobody is waited for; return whether it did."""
        if self._started or self.waiting_for(placed):
            return False
        self._started = True
        # An evaluator is optional: it takes part if it is there in time, or joins later.
        for name in (self._present & (self._expected | {"evaluator"})) - _ONLOOKERS:
            self._barrier.join(name)
        return True

    def acknowledge(self, name: str, tick: int) -> None:
        """Note that `name` is done with `tick`."""
        if self._started:
            self._barrier.acknowledge(name, tick)

    def missing(self) -> tuple[str, ...]:
        """Return who has not acknowledged; the evaluator may lag, but not at the ends."""
        return self._barrier.missing(strict=self.tick == 0 or self.is_last_tick)

    def drop_missing(self) -> tuple[str, ...]:
        """Wait no longer for those who are missing, and return them."""
        missing = self.missing()
        self._barrier.drop(missing)
        return missing

    def lacks_cameras(self) -> bool:
        """Whether time stands still because no camera takes part (lockstep)."""
        return self.lockstep and not self._barrier.waits_for_any("camera")

    def may_end_tick(self) -> bool:
        """Whether all have acknowledged and the clock is not held."""
        held = self._paused and self._steps_left == 0
        if not self.lockstep or not self._started or self._finished or held:
            return False
        return not self.lacks_cameras() and not self.missing()

    def end_tick(self) -> bool:
        """Go to the next tick; return whether there is one."""
        self._steps_left = max(0, self._steps_left - 1)
        if self.is_last_tick:
            self._finished = True
            return False
        self.tick += 1
        self._barrier.begin(self.tick)
        return True

    def pause(self) -> None:
        """Hold after the tick at hand."""
        self._paused, self._steps_left = True, 0

    def resume(self) -> None:
        """Run."""
        self._paused, self._steps_left = False, 0

    def step(self, ticks: int) -> None:
        """Let so many more ticks pass while paused."""
        self._steps_left += ticks

    def reset(self) -> None:
        """Go back to before tick 0; who is there stays."""
        self.tick = 0
        self._barrier.restart()
        self._started = self._finished = False
        self._steps_left = 0
