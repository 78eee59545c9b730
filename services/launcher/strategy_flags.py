"""Which formation `encircle run` is told to make, and how far it looks ahead."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class StrategyFlags(BaseModel):
    """Flat, as all flags of a run."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    strategy: Literal[
        "circle",
        "adaptive_scale",
        "constant_angles",
        "adaptive_angles",
        "rings",
        "sphere",
        "orbit",
        "random",
        "static",
        "dome",
    ] = "circle"
    """circle: a ring around the moving target; adaptive_scale: one that opens where the way is
    straight; constant_angles, adaptive_angles: robots give way on it in turns; rings: several, one
    above the other; sphere: evenly over a cap; orbit: a ring that turns; random: views drawn anew
    every so often; static: a ring at rest; dome: view after view."""
    radius_max: Annotated[float, Field(gt=0, le=100)] | None = None
    """Adaptive_scale opens no farther, metres; twice the radius if not given."""
    forecast: Literal["twist", "path"] | None = None
    """What strategies that look ahead expect: twist: the object goes on as it does; path: it drives
    along its path. The path, if not given, where the planner is told where the object is."""
    horizon: Annotated[float, Field(gt=0, le=600)] = 20.0
    """How far those look ahead, seconds."""
