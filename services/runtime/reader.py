"""One subscription's messages, for code that waits for them itself (tests, tools, the launcher)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar

from schemas.message import Envelope, Message
from services.runtime.inbox import Inbox

M = TypeVar("M", bound=Message, covariant=True)


@dataclass(frozen=True)
class Received(Generic[M]):
    """A message as it came."""

    key: str
    camera: int | None
    """The camera index in the key."""
    envelope: Envelope
    message: M
    t_recv_ns: int
    """Wall clock of the receiver."""


class Reader(Generic[M]):
    """Iterate over what arrives, or `get` the next; closes with its `with` block."""

    def __init__(
        self,
        inbox: Inbox[Any],
        decode: Callable[[Any], Received[M] | None],
        stop: Callable[[], None],
    ) -> None:
        self._inbox = inbox
        self._decode = decode
        self._stop = stop

    def get(self, timeout_s: float | None = None) -> Received[M]:
        """Wait for the next valid message; what is invalid is counted and passed over.

        Raises:
            TimeoutError: If none came in time, or the reader was closed.
        """
        while (item := self._inbox.get(timeout_s)) is not None:
            if (received := self._decode(item)) is not None:
                return received
        raise TimeoutError(f"no message within {timeout_s} s")

    def __iter__(self) -> Iterator[Received[M]]:
        while True:
            try:
                yield self.get()
            except TimeoutError:
                return

    def close(self) -> None:
        """Stop the subscription; whoever waits is woken."""
        self._stop()
        self._inbox.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
