"""The page: everything a browser shows."""

from collections.abc import Mapping
from dataclasses import dataclass

from services.viewer.controls import Reports
from services.viewer.options import Options
from services.viewer.plots import Plots
from services.viewer.primitives import Frame, Image
from services.viewer.web_guard import WebGuard
from services.viewer.web_images import WebImages
from services.viewer.web_panel import Ask, WebPanel
from services.viewer.web_plots import WebPlots
from services.viewer.web_replay import WebReplay
from services.viewer.web_scene import WebScene
from services.viewer.web_server import open_server, url_of
from services.viewer.web_view import WebView


@dataclass(frozen=True)
class Panel:
    """What stands beside the picture."""

    reports: Reports
    line: str
    notices: list[str]
    plots: Plots
    images: Mapping[int, Image]


class Web:
    """Draws; knows no bus. All but what the browsers call belongs to one thread.

    Raises:
        MissingExtra: If viser is not installed.
    """

    def __init__(
        self, host: str, port: int, guard: WebGuard, max_points: int, ask: Ask, *, dark: bool
    ) -> None:
        self.server = open_server(host, port, guard, dark=dark)
        self._panel = WebPanel(self.server, ask)
        self._replay = WebReplay(self.server, ask)
        self._view = WebView(self.server, max_points, dark=dark)
        self._plots = WebPlots(self.server)
        self._images = WebImages(self.server)
        self._scene = WebScene(self.server)

    @property
    def url(self) -> str:
        """Where a browser on this machine finds the page."""
        return url_of(self.server)

    @property
    def port(self) -> int:
        """The port that was free."""
        port: int = self.server.get_port()
        return port

    @property
    def num_browsers(self) -> int:
        """How many look."""
        return len(self.server.get_clients())

    def options(self) -> Options:
        """Return what is to be shown."""
        return self._view.options()

    def draw(self, frame: Frame) -> None:
        """Show a frame; browsers see all of it or nothing of it."""
        with self.server.atomic():
            self._scene.draw(frame)

    def draw_panel(self, panel: Panel) -> None:
        """Show what stands beside the picture."""
        with self.server.atomic():
            self._panel.draw(panel.reports, panel.line, panel.notices)
            self._replay.draw(panel.reports)
            self._plots.draw(panel.plots)
            self._images.draw(panel.images)

    def close(self) -> None:
        """Serve no more."""
        self.server.stop()
