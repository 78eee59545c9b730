"""The report as a table for the reader of the terminal."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table

_SHARES = {
    "coverage_visible": "coverage of what the cameras see",
    "coverage_observable": "coverage of what can be seen",
    "coverage": "coverage of the whole surface",
    "precision": "precision",
    "f_score": "F-score",
    "ghost_rate": "ghosts",
}


def summary(figures: Mapping[str, Any]) -> Table:
    """Draw the figures of a report."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="dim")
    table.add_column()
    table.add_row("instants", f"{figures['ticks']} of {figures['sim_s']:.1f} simulated seconds")
    if (rate := figures["perceptions_per_s"]) is not None:
        whole = f"{rate:.1f} per second, each fused from {figures['cameras']} cameras"
        table.add_row("perceptions", whole)
    if figures["startup_s"] is not None:
        table.add_row("first map after", f"{figures['startup_s']:.1f} s")
    for key, label in (("fuse_ms", "fusing"), ("latency_ms", "shutter to map")):
        if figures[key] is not None:
            table.add_row(label, f"p50 {figures[key]['p50']:.1f} ms, p95 {figures[key]['p95']:.1f}")
    if (target := figures["target"]) is not None:
        place, missed = target["place_m"], target["missed"]
        errors = f"{place['rms'] * 1000:.0f} mm RMS, {place['max'] * 1000:.0f} mm at most"
        table.add_row("target estimate off", f"{errors}; not seen at {missed} instants")
    for key, label in _SHARES.items():
        if figures[key] is not None:
            parts = (f"{figure} {value:.1%}" for figure, value in figures[key].items())
            table.add_row(label, ", ".join(parts))
    troubles = ("missed_clouds", "bad_messages", "restarts")
    table.add_row(
        "troubles", ", ".join(f"{key.replace('_', ' ')} {figures[key]}" for key in troubles)
    )
    return table
