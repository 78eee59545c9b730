"""`encircle health SERVICE`: is it there, for those who restart what is not?"""

import argparse
import sys
from collections.abc import Sequence

from services.launcher.errors import SettingsError
from services.runtime.drains import Drains
from services.runtime.errors import BusUnavailable
from services.runtime.presence import Presence
from services.runtime.roles import SINGLES, roles
from services.runtime.session import open_client
from services.runtime.settings import BusSettings

HEALTHY, UNHEALTHY = 0, 1
_AS = "inspector"
_TIMEOUT_S = 3.0


def health(args: Sequence[str]) -> int:
    """Carry out `encircle health`: 0 when the service is on the bus, 1 when it is not.

    The router counts as healthy when it takes a new session: one that only keeps its old ones is
    of no use to whoever comes next. It alone is asked: whoever asked as a peer would make, and
    break, a link to every service of the ring.

    Raises:
        SettingsError: If the name is none of a service.
    """
    parser = argparse.ArgumentParser(prog="encircle health", description=__doc__)
    parser.add_argument("service", help="e.g. mapper, camera/3, router")
    wanted = parser.parse_args(args).service
    if wanted not in {role.name for role in roles()}:
        raise SettingsError(
            f"no service {wanted!r}; known: {', '.join(SINGLES)}, and camera/<index>"
        )
    try:
        with open_client(BusSettings(), _AS, _TIMEOUT_S) as session:
            if wanted == "router":
                return _well(wanted)
            alive = Presence(session, _AS, Drains()).everybody(_TIMEOUT_S)
    except BusUnavailable as error:
        return _ill(str(error))
    if (wanted if "/" in wanted else f"{wanted}/0") in alive:
        return _well(wanted)
    return _ill(f"{wanted} is not on the bus; there are: {', '.join(sorted(alive)) or 'none'}")


def _well(service: str) -> int:
    print(f"{service}: healthy")
    return HEALTHY


def _ill(reason: str) -> int:
    print(reason, file=sys.stderr)
    return UNHEALTHY
