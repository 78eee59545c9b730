"""The threads that carry samples from zenoh to us, and their end."""

import threading
import time
from collections.abc import Callable

_JOIN_TIMEOUT_S = 1.0


class Drains:
    """Starts a thread per subscription and waits for all when the session has been closed.

    A thread that is still inside zenoh when the interpreter ends is frozen there, possibly with
    one of zenoh's locks; what is then collected waits for that lock, and the process never ends.
    """

    def __init__(self) -> None:
        self._threads: list[threading.Thread] = []

    def start(self, name: str, drain: Callable[[], None]) -> None:
        """Run `drain` until its subscription ends."""
        thread = threading.Thread(target=drain, name=name, daemon=True)
        thread.start()
        self._threads.append(thread)

    def join(self) -> None:
        """Wait until all have ended; only after the session was closed."""
        deadline_s = time.monotonic() + _JOIN_TIMEOUT_S
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(max(0.0, deadline_s - time.monotonic()))
        self._threads.clear()
