"""Who is on the bus: liveliness tokens on `alive/<service>/<instance>`."""

import time
from collections.abc import Callable

import zenoh

from services.runtime.drains import Drains

_ROOT = "alive"
_RING = 256  # Changes that may wait for the one thread that passes them on.

# On a busy machine zenoh 1.10 answers one such question in ten with nobody at all, though it knows
# the tokens: what is said at once ends before it has begun. Asked again it answers.
_TRIES = 6
_PAUSE_S = 0.01


class Presence:
    """A session's own token, once announced, and the view of the others'.

    A token vanishes with its process: at once when it is killed, after the lease when it freezes.
    """

    def __init__(self, session: zenoh.Session, address: str, drains: Drains) -> None:
        service, _, instance = address.partition("/")
        self._key = f"{_ROOT}/{service}/{instance or 0}"
        self._liveliness = session.liveliness()
        self._drains = drains
        self._token: zenoh.LivelinessToken | None = None

    def announce(self) -> None:
        """Show that this service is there: when it listens, and not before."""
        if self._token is None:
            self._token = self._liveliness.declare_token(self._key)

    def watch(self, service: str, put: Callable[[str, bool], None]) -> Callable[[], None]:
        """Call `put(instance, alive)` for every instance that is there, comes or goes.

        Returns:
            A function that ends the watch.
        """
        subscriber = self._liveliness.declare_subscriber(
            f"{_ROOT}/{service}/*", zenoh.handlers.RingChannel(_RING), history=True
        )

        def drain() -> None:
            for sample in subscriber:
                instance = str(sample.key_expr).rsplit("/", 1)[1]
                put(instance, sample.kind == zenoh.SampleKind.PUT)

        self._drains.start(f"{_ROOT}/{service}", drain)
        return subscriber.undeclare

    def everybody(self, timeout_s: float = 1.0) -> set[str]:
        """Return who is there now, as `service/instance`."""
        for _ in range(_TRIES):
            replies = self._liveliness.get(f"{_ROOT}/*/*", timeout=timeout_s)
            keys = (str(reply.ok.key_expr) for reply in replies if reply.ok is not None)
            if there := {key.removeprefix(f"{_ROOT}/") for key in keys}:
                return there
            time.sleep(_PAUSE_S)
        return set()
