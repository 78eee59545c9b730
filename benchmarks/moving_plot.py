"""Draw the ghosts of every frame, a panel per scene."""

from matplotlib.figure import Figure
from moving_scene import RATE_HZ

COLORS = {
    "OctoMap": "#D55E00",
    "ours, OctoMap's model": "#E69F00",
    "ours, decay 0.5 s": "#999999",
    "ours, clear 3, appear 1": "#56B4E9",
    "ours, clear 2, appear 1": "#0072B2",
    "ours, clear 1, appear 1": "#009E73",
}
"""What is drawn, and in which of Okabe and Ito's colors."""
Curves = list[tuple[str, list[int]]]


def plot(scenes: dict[str, Curves], path: str) -> None:
    """Write a chart: time against ghosts, a panel per scene.

    Args:
        scenes: title to the curves' names and ghosts per frame.
        path: of the picture.
    """
    columns = 2
    rows = -(-len(scenes) // columns)
    figure = Figure(figsize=(9.0, 2.5 * rows + 0.6), dpi=100, layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for panel, (title, curves) in zip(panels, scenes.items(), strict=False):
        for name, ghosts in curves:
            if name in COLORS:
                time_s = [n / RATE_HZ for n in range(len(ghosts))]
                width = 2.0 if "clear" in name else 1.5
                panel.plot(time_s, ghosts, color=COLORS[name], lw=width, label=name)
        panel.set_title(title, fontsize=10)
        panel.grid(alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    for panel in panels[::columns]:
        panel.set_ylabel("ghost voxels")
    for panel in panels[-columns:]:
        panel.set_xlabel("s")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path)
