"""Who may see the page, and steer from it."""

import hashlib
import hmac
import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode, urlsplit

SHORTEST_TOKEN = 16
"""Characters; `openssl rand -hex 16` makes 32. Nobody guesses 16 over a network."""
_LOCAL_NAME = re.compile(r"[a-z0-9_-]+|[a-z0-9_.-]+\.(local|localhost)")
_PURPOSE = b"encircle viewer cookie"


class AdmissionError(ValueError):
    """The page must not be served in this way."""


@dataclass(frozen=True)
class Admitted:
    """Serve it."""


@dataclass(frozen=True)
class Welcomed:
    """The token was in the address: keep it as a cookie, and go on where it is not to be read."""

    location: str
    cookie: str


@dataclass(frozen=True)
class Refused:
    """Serve nothing; `reason` is for the log and for whoever asked."""

    reason: str


class Admission:
    """Judges requests by their first lines, pages and websockets alike.

    With a token, it or the cookie that stands for it is asked for. Without, the page is for this
    machine, and a browser on it must not be made to speak for a site that it has open: neither
    from another origin, nor under a name of that site's own which resolves to us (DNS rebinding).

    Raises:
        AdmissionError: If the token is too short, or strangers could come in without one.
    """

    def __init__(self, token: str, host: str, *, insecure: bool = False) -> None:
        if token and len(token) < SHORTEST_TOKEN:
            raise AdmissionError(
                f"token has {len(token)} characters; it must have {SHORTEST_TOKEN} or more"
            )
        if not token and not insecure and not _is_loopback(host):
            raise AdmissionError(
                f"host {host!r} lets the network steer; give a token (ENCIRCLE_VIEWER_TOKEN), "
                "or say that this is meant (--insecure), or use --host 127.0.0.1"
            )
        self._token = token.encode()
        # The cookie does not tell the token, and is the same after a restart: pages reconnect.
        self._secret = hmac.new(self._token, _PURPOSE, hashlib.sha256).hexdigest()
        # Browsers keep cookies per host, not per port: two viewers must not take each other's.
        self._cookie = f"encircle_{hashlib.sha256(self._secret.encode()).hexdigest()[:8]}"

    @property
    def asks(self) -> bool:
        """Whether a token is asked for."""
        return bool(self._token)

    def judge(self, path: str, headers: Mapping[str, str]) -> Admitted | Welcomed | Refused:
        """Decide on a request.

        Args:
            path: As in the request's first line, with the query. headers: Upgrade, Host, Origin
                and Cookie are looked at, in any case.
        """
        told = {name.lower(): value for name, value in headers.items()}
        host, origin = told.get("host", ""), told.get("origin")
        if origin is not None and _host_of(origin) != host.lower():
            return Refused(f"origin {origin!r:.80} is not the page's own, {host!r:.80}")
        if not self._token:
            if not _is_ours(host):
                return Refused(f"host {host!r:.80} is neither an address nor a local name")
            return Admitted()
        query = parse_qsl(urlsplit(path).query, keep_blank_values=True)
        given = [value for name, value in query if name == "token"]
        is_websocket = told.get("upgrade", "").lower() == "websocket"
        if len(given) == 1 and hmac.compare_digest(given[0].encode(), self._token):
            if is_websocket:
                return Admitted()
            rest = urlencode([pair for pair in query if pair[0] != "token"])
            # Never to the path that was asked for: `//elsewhere` would lead away.
            cookie = f"{self._cookie}={self._secret}; Path=/; HttpOnly; SameSite=Lax"
            return Welcomed(f"/?{rest}" if rest else "/", cookie)
        if given:
            return Refused("wrong token")
        shown = self._cookie_in(told.get("cookie", ""))
        if hmac.compare_digest(shown.encode(), self._secret.encode()):
            return Admitted()
        return Refused("no token")

    def _cookie_in(self, header: str) -> str:
        try:
            morsel = SimpleCookie(header).get(self._cookie)
        except CookieError:
            return ""
        return "" if morsel is None else morsel.value


def _host_of(origin: str) -> str:
    """Return host and port of an origin, in lower case; empty if it has none (`null`)."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _is_ours(host: str) -> bool:
    """Whether no site on the internet can have this name: an address, or a name of the house."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return _LOCAL_NAME.fullmatch(name) is not None
    return True
