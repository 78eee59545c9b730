"""The page's server: on the loopback, without the button that shares it with the world."""

import contextlib
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from services.runtime.errors import MissingExtra
from services.viewer.web_guard import GuardMissing, WebGuard

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)

_EYE_M = (-1.5, -1.3, 1.45)
_LOOKS_AT_M = (0.0, 0.0, 0.18)
_PANEL_WIDTH_PX = 400.0
_BRAND = (60, 120, 220)


def open_server(host: str, port: int, guard: WebGuard, *, dark: bool) -> "viser.ViserServer":
    """Serve the page at the port, or at the next one that is free, to whom the guard lets in.

    Raises:
        GuardMissing: If viser serves in a way that the guard does not know.
        MissingExtra: If viser is not installed.
    """
    try:
        import viser  # In the viewer's extra: others must run without.
    except ModuleNotFoundError as error:
        raise MissingExtra(
            f"{error.name} is not installed; pip install 'encircle[viewer]'"
        ) from None
    # Viser prints a banner to standard output, which is a log here.
    with contextlib.redirect_stdout(None):
        server = _guarded(lambda: viser.ViserServer(host, port, "encircle", verbose=False), guard)
    # The button is hidden, but whoever speaks viser's protocol could still ask for its relay.
    server.request_share_url = _refuse_to_share  # type: ignore[method-assign]
    server.initial_camera.position = _EYE_M
    server.initial_camera.look_at = _LOOKS_AT_M
    server.scene.set_up_direction("+z")
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(_PANEL_WIDTH_PX)
    set_theme(server, dark=dark)
    return server


def _guarded(begin: Callable[[], "viser.ViserServer"], guard: WebGuard) -> "viser.ViserServer":
    begun: list[viser.ViserServer] = []
    try:
        with guard.before_servers():
            begun.append(begin())
    except GuardMissing:
        for server in begun:
            server.stop()
        raise
    return begun[0]


def _refuse_to_share(*_: object, **__: object) -> None:
    logger.warning("a browser asked for an outside relay to this page: refused")


def set_theme(server: "viser.ViserServer", *, dark: bool) -> None:
    """Choose light or dark for all browsers. Viser's share button would open an outside relay."""
    server.gui.configure_theme(
        dark_mode=dark, show_logo=False, show_share_button=False, brand_color=_BRAND
    )


def url_of(server: "viser.ViserServer") -> str:
    """Return where a browser on this machine finds the page."""
    host = server.get_host()
    # Told, not bound.
    here = ("127.0.0.1", "0.0.0.0", "::1", "::")  # nosec B104
    shown = "localhost" if host in here else host
    return f"http://{shown}:{server.get_port()}"
