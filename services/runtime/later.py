"""An answer that takes work which must not hold up the messages."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Later(Generic[T]):
    """What a request still needs, once its parameters are found to be good."""

    work: Callable[[], T]
    """Called on a thread beside the loop's; touches nothing of the service's state."""
    then: Callable[[T], dict[str, Any]]
    """Called on the loop's thread with what the work returned; returns the answer."""
