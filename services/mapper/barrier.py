"""Collects the clouds of an instant: hands them on in camera order, closes when none is missing.

Clouds are handed on as soon as all cameras before them have spoken, so that fusing overlaps with
waiting, and the order of fusing never depends on the order of arrival.
"""

from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

_MOST_OPEN = 64  # Instants that may wait; four seconds, far more than a deadline.


@dataclass(frozen=True)
class Take(Generic[T]):
    """Fuse this cloud now."""

    tick: int
    camera: int
    cloud: T


@dataclass(frozen=True)
class Close:
    """The instant is complete, or as complete as it will be."""

    tick: int
    used: tuple[int, ...]
    missing: tuple[int, ...]


class Barrier(Generic[T]):
    """A camera is waited for if it is alive, has not gone past the tick and is not known to fail.

    One that comes when instants have been closed may not have its place yet: it joins by speaking.

    A camera's own ticks only grow: one that is already further will not speak for this tick, and
    one that goes back tells of a new run. Who misses a deadline is not waited for until it speaks.
    """

    def __init__(self) -> None:
        self.num_late = 0
        """Clouds that came after their instant had been closed."""
        self._alive: set[int] = set()
        self._coming: set[int] = set()
        self._failed: set[int] = set()
        self._newest: dict[int, int] = {}
        self._pending: dict[int, dict[int, T]] = {}
        self._taken: list[int] = []
        self._closed = -1
        self._used: tuple[int, ...] = ()
        """Cameras of the instant that was closed last."""

    @property
    def alive(self) -> tuple[int, ...]:
        """Cameras that are there, whether waited for or not."""
        return tuple(sorted(self._alive | self._coming))

    @property
    def open_tick(self) -> int | None:
        """The tick that is being collected, if any."""
        return min(self._pending, default=None)

    def appear(self, camera: int) -> None:
        """Wait for a camera from now on; one that comes late, from its first word on."""
        if self._closed >= 0 and camera not in self._newest:
            self._coming.add(camera)
            return
        self._alive.add(camera)
        self._failed.discard(camera)

    def vanish(self, camera: int) -> list[Take[T] | Close]:
        """Wait no longer for a camera."""
        self._alive.discard(camera)
        self._coming.discard(camera)
        self._newest.pop(camera, None)
        return self._advance()

    def offer(self, tick: int, camera: int, cloud: T) -> list[Take[T] | Close]:
        """Take a cloud in; return what is to be done now."""
        if tick < self._newest.get(camera, 0):
            self._restart()
        self._alive.add(camera)
        self._coming.discard(camera)
        self._failed.discard(camera)
        self._newest[camera] = tick
        if tick <= self._closed or camera in self._taken_at(tick):
            repeated = tick == self._closed and camera in self._used
            self.num_late += tick <= self._closed and not repeated
        else:
            self._pending.setdefault(tick, {})[camera] = cloud
            if len(self._pending) > _MOST_OPEN:  # Somebody counts in another way.
                del self._pending[max(self._pending)]
        return self._advance()

    def expire(self) -> list[Take[T] | Close]:
        """Close the open tick with what has come; whoever is missing has failed."""
        tick = self.open_tick
        if tick is None:
            return []
        self._failed |= {camera for camera in self._alive if self._newest.get(camera, -1) < tick}
        return self._advance()

    def _taken_at(self, tick: int) -> list[int]:
        return self._taken if tick == self.open_tick else []

    def _restart(self) -> None:
        self._newest.clear()
        self._pending.clear()
        self._taken.clear()
        self._closed, self._used = -1, ()

    def _advance(self) -> list[Take[T] | Close]:
        steps: list[Take[T] | Close] = []
        while (tick := self.open_tick) is not None:
            clouds = self._pending[tick]
            for camera in sorted(self._alive | set(clouds)):
                if camera in clouds:
                    steps.append(Take(tick, camera, clouds.pop(camera)))
                    self._taken.append(camera)
                    self._closed = tick - 1  # Fusing has begun: whatever is older is late.
                elif camera not in self._failed and self._newest.get(camera, -1) < tick:
                    return steps
            used = tuple(self._taken)
            missing = tuple(sorted(self._alive - set(used)))
            steps.append(Close(tick, used, missing))
            self._closed, self._used = tick, used
            self._taken.clear()
            del self._pending[tick]
        return steps
