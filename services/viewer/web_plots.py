"""Curves in the panel."""

from typing import TYPE_CHECKING, Any

import numpy as np

from services.viewer.colours import Rgb, camera_colour
from services.viewer.plots import Curves, Plots

if TYPE_CHECKING:
    import viser

_HEIGHT_PX = 150
_MOST_PLOTS = 8
_QUALITY: tuple[tuple[str, Rgb], ...] = (
    ("of visible", (46, 160, 110)),
    ("of all", (60, 120, 220)),
    ("F-score", (213, 94, 0)),
)
_FUSING: tuple[tuple[str, Rgb], ...] = (
    ("fusing", (60, 120, 220)),
    ("shutter to map", (150, 150, 150)),
)


class WebPlots:
    """Three plots; that of the cameras is another when other cameras are there.

    Those of before are hidden, not removed; see `WebImages`. The oldest of many go: they have not
    been brought up to date for so long that no browser can be that far behind.
    """

    def __init__(self, server: "viser.ViserServer") -> None:
        self._gui = server.gui
        self._folder = server.gui.add_folder("Plots", order=30)
        with self._folder:
            self._quality = self._plot("Coverage and F-score (%)", _QUALITY, 1)
            self._fusing = self._plot("Fuse time (ms)", _FUSING, 2)
        self._rates: dict[tuple[int, ...], Any] = {}
        """By the cameras that it shows; the last one is up to date."""

    def draw(self, plots: Plots) -> None:
        """Bring the plots up to date."""
        self._quality.data = plots.quality.curves()
        self._fusing.data = plots.fusing.curves()
        if plots.cameras:
            self._rates_of(plots.cameras).data = plots.rates.curves()

    def _rates_of(self, cameras: tuple[int, ...]) -> Any:
        if next(reversed(self._rates), None) == cameras:
            return self._rates[cameras]
        handle = self._rates.pop(cameras, None)
        if handle is None:
            lines = tuple((f"camera {camera}", camera_colour(camera)) for camera in cameras)
            with self._folder:
                handle = self._plot("Camera rates (Hz)", lines, 3)
        for other in self._rates.values():
            other.visible = False
        handle.visible = True
        self._rates[cameras] = handle
        if len(self._rates) > _MOST_PLOTS:
            self._rates.pop(next(iter(self._rates))).remove()
        return handle

    def _plot(self, title: str, lines: tuple[tuple[str, Rgb], ...], order: int) -> Any:
        from viser import uplot

        series = (uplot.Series(label="s"), *(_series(label, colour) for label, colour in lines))
        empty: Curves = tuple(np.zeros(1) for _ in series)
        return self._gui.add_uplot(
            empty,
            series,
            title=title,
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(auto=True)},
            legend=uplot.Legend(show=len(lines) <= 3),
            height=_HEIGHT_PX,
            order=order,
        )


def _series(label: str, colour: Rgb) -> Any:
    from viser import uplot

    return uplot.Series(label=label, stroke=f"rgb{colour}", width=2)
