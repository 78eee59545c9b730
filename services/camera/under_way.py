"""Which of a camera's clouds are under way: no link is given more than it carries."""

from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

LOST_AFTER_S = 3.0
"""If nothing was heard for so long, what is under way never arrives; links are given up after as
long. A link that takes longer for a single cloud is beyond what can be held young."""


@dataclass(frozen=True)
class Sent:
    """A cloud that its mapper has not told of."""

    tick: int
    sent_s: float


class UnderWay(Generic[T]):
    """Holds a cloud back while too many are under way; a newer one takes the place of what waits.

    TCP takes megabytes before it says that a link is full: seconds of a slow one, and every cloud
    behind them comes too late to be of use. So the mapper says of each cloud that it has it, and a
    camera lets few be between them. Without a mapper, or one that says nothing, all are let go.
    """

    def __init__(self, most: int) -> None:
        """Let `most` be under way at once; 0: any number."""
        self._most = most
        self._sent: deque[Sent] = deque()
        self._waiting: tuple[int, T] | None = None
        self._is_told = False
        self._told_s = 0.0
        self.num_replaced = 0
        """Clouds that never left, as newer ones took their place."""

    def offer(self, tick: int, cloud: T, now_s: float) -> T | None:
        """Take a cloud in; return it if it is to be sent now."""
        self.num_replaced += self._waiting is not None
        self._waiting = tick, cloud
        return self._next(now_s)

    def heard(self, tick: int, now_s: float) -> T | None:
        """Note that the mapper has all up to a tick; return what is to be sent now."""
        self._is_told, self._told_s = True, now_s
        if any(each.tick == tick for each in self._sent):
            while self._sent.popleft().tick != tick:
                pass  # Who has this one will not have those before; they may be of another run.
        else:
            while self._sent and self._sent[0].tick <= tick:
                self._sent.popleft()
        return self._next(now_s)

    def drop(self) -> None:
        """Time waits for all now: nothing is held back, and what waited is of no use any more."""
        self._sent.clear()
        self._waiting = None

    def forget(self, now_s: float) -> T | None:
        """The mapper has gone, or another has come; return what is to be sent now."""
        self._is_told = False
        self._sent.clear()
        return self._next(now_s)

    def _next(self, now_s: float) -> T | None:
        if self._sent and now_s - max(self._sent[0].sent_s, self._told_s) > LOST_AFTER_S:
            self._sent.clear()
        is_full = self._is_told and self._most and len(self._sent) >= self._most
        if self._waiting is None or is_full:
            return None
        (tick, cloud), self._waiting = self._waiting, None
        if self._is_told:
            self._sent.append(Sent(tick, now_s))
        return cloud
