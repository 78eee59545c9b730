"""The folder "View": what is shown and in which colours; all browsers share it."""

from typing import TYPE_CHECKING, Any

from services.viewer.options import Options
from services.viewer.voxels import ColourBy
from services.viewer.web_server import set_theme

if TYPE_CHECKING:
    import viser

_SWITCHES = {
    "follow": "Follow target",
    "voxels": "Voxels",
    "cameras": "Cameras in 3D",
    "wedges": "Field of view",
    "formation": "Formation",
    "trail": "Target path",
    "cloud": "Merged cloud",
    "truth": "Truth surface",
    "coverage": "Coverage error",
}
_HINTS = {
    "follow": "The target stays in the middle, and the ground passes below it.",
    "wedges": "What each camera has in view, seen from above.",
    "trail": "Where the target has been; the last 5 s are bright.",
    "cloud": "All cameras' returns, each in its camera's colour.",
    "truth": "The simulated object itself.",
    "coverage": "On the true surface: green is in the map, orange is seen and not in the map, "
    "grey no camera sees; magenta voxels are nowhere near it.",
}


class WebView:
    """Switches, read whenever a frame is drawn."""

    def __init__(self, server: "viser.ViserServer", max_points: int, *, dark: bool) -> None:
        begin = Options(max_points=max_points)
        self._max_points = max_points
        with server.gui.add_folder("View", order=35):
            self._colour_by: Any = server.gui.add_dropdown(
                "Colour by",
                tuple(each.value for each in ColourBy),
                hint="Of the voxels. Age: bright is new, dark has been there for 5 s.",
            )
            self._switches: dict[str, Any] = {
                name: server.gui.add_checkbox(label, getattr(begin, name), hint=_HINTS.get(name))
                for name, label in _SWITCHES.items()
            }
            self._dark: Any = server.gui.add_checkbox("Dark", dark)
            self._dark.on_update(lambda _: set_theme(server, dark=bool(self._dark.value)))
        self._colours = begin.colour_by

    def options(self) -> Options:
        """Return what is wanted now."""
        return Options(
            colour_by=self._chosen(),
            max_points=self._max_points,
            dark=bool(self._dark.value),
            **{name: bool(handle.value) for name, handle in self._switches.items()},
        )

    def _chosen(self) -> ColourBy:
        """Return what voxels are coloured by; a word that is not offered changes nothing."""
        try:
            self._colours = ColourBy(self._colour_by.value)
        except ValueError:  # A browser may send what its page does not offer.
            self._colour_by.value = self._colours.value
        return self._colours
