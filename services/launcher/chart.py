"""The quality of the map over time, as a picture."""

from pathlib import Path

from services.launcher.report import Record

# Colours of Okabe & Ito, 2008: told apart by the colour-blind as well. The first curve is wide,
# as it and precision are often 1 both.
_CURVES = (
    ("coverage_visible", "coverage of what is visible now", "#009E73", 4.0),
    ("coverage_observable", "coverage of what is observable", "#56B4E9", 1.6),
    ("coverage", "coverage of the whole surface", "#0072B2", 1.6),
    ("precision", "precision", "#D55E00", 1.6),
    ("f_score", "F-score", "#000000", 1.6),
)
_INK, _GRID = "#333333", "#DDDDDD"


def draw(record: Record, path: Path, title: str) -> None:
    """Draw coverage, precision and F-score over simulated time.

    Raises:
        ImportError: If matplotlib is not installed.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import PercentFormatter

    figure = Figure(figsize=(10, 6), layout="constrained")
    axes = figure.add_subplot()
    scores = record.scores
    lowest = 1.0
    for name, label, colour, width in _CURVES:
        column = f"stamp_true.two_voxels.{name}"
        values = scores.values(column)
        mean = scores.figures(column)["mean"] if len(scores) else 0.0
        label = f"{label}, mean {mean:.1%}"
        axes.plot(scores.values("t_s"), values, color=colour, lw=width, label=label)
        lowest = min([lowest, *values])
    tolerance_mm = (record.tolerance_m or 0.0) * 1e3
    axes.set_title(title, loc="left", color=_INK, fontsize=12, fontweight="bold")
    axes.set_xlabel("simulated time, s", color=_INK)
    axes.set_ylabel(f"share within {tolerance_mm:g} mm", color=_INK)
    room = 0.1 * (1.0 - lowest) + 0.002
    axes.set_ylim(max(0.0, lowest - room), 1.0 + room)
    axes.margins(x=0.01)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.grid(color=_GRID, lw=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(colors=_INK, length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    figure.legend(frameon=False, labelcolor=_INK, loc="outside lower left", ncols=3)
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=110)
