"""What has arrived and waits for its service: newest per slot, or all in order."""

import threading
import time
from collections import OrderedDict, deque
from collections.abc import Hashable
from itertools import count
from typing import Generic, TypeVar

T = TypeVar("T")

MAX_QUEUED = 1024  # Of one kept-in-order stream; the oldest goes first and its number shows it.


class Inbox(Generic[T]):
    """A thread-safe queue in which a newer item may take an older one's place.

    A slot's item keeps its place in the queue when it is replaced, so a flood on one key neither
    grows the queue nor starves the others.
    """

    def __init__(self) -> None:
        self._items: OrderedDict[Hashable, T] = OrderedDict()
        self._queued: dict[Hashable, deque[Hashable]] = {}
        self._numbers = count()
        self._changed = threading.Condition()
        self._closed = False

    def put_latest(self, slot: Hashable, item: T) -> None:
        """Put an item in the place of the one that waits in `slot`, or at the end."""
        with self._changed:
            self._items[slot] = item
            self._changed.notify()

    def put_next(self, stream: Hashable, item: T) -> None:
        """Append an item; beyond `MAX_QUEUED` of its stream, the stream's oldest is let go."""
        with self._changed:
            slot = (stream, next(self._numbers))
            waiting = self._queued.setdefault(stream, deque())
            if len(waiting) >= MAX_QUEUED:
                self._items.pop(waiting.popleft(), None)
            waiting.append(slot)
            self._items[slot] = item
            self._changed.notify()

    def get(self, timeout_s: float | None) -> T | None:
        """Take the oldest item; None when none came in time or the inbox was closed."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        with self._changed:
            while not self._items:
                left = None if deadline is None else deadline - time.monotonic()
                if self._closed or (left is not None and left <= 0):
                    return None
                self._changed.wait(left)
            slot, item = self._items.popitem(last=False)
            if isinstance(slot, tuple):
                self._queued[slot[0]].popleft()
            return item

    def close(self) -> None:
        """Wake whoever waits; `get` still hands out what is left, then None."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._closed
