"""How good the map is at one instant, against the truth of that instant."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from schemas.message import Message

Share = Annotated[float, Field(ge=0, le=1)]
Distance = Annotated[float, Field(ge=0)]


class Score(BaseModel):
    """One tolerance's figures (Tanks-and-Temples style)."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    tolerance_m: Distance
    coverage: Share
    """Of the whole surface, the share within the tolerance of an occupied voxel: recall."""
    coverage_observable: Share
    """The same, of the surface that at least one admissible view can see."""
    coverage_visible: Share
    """The same, of the surface that the cameras see at this very instant."""
    precision: Share
    """Share of occupied voxels within the tolerance of the surface."""
    f_score: Share
    ghost_rate: Share
    """1 - precision."""


class Missing(BaseModel):
    """Why surface is not in the map; shares of the whole surface, they sum to 1 - coverage."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    out_of_view: Share
    self_occluded: Share
    grazing: Share
    not_yet_updated: Share


class Quality(Message):
    """The map of instant `tick` against the surface: as it was then, and as it is now."""

    rev: int
    stamp_true: tuple[Score, Score]
    """Against the surface at the map's own instant; tolerances resolution, 2 x resolution."""
    latency_true: tuple[Score, Score]
    """Against the surface at the newest instant known when the map arrived."""
    lag_ticks: Annotated[int, Field(ge=0)]
    """How many instants the surface was ahead of the map."""
    missing: Missing
    accuracy_m: Distance | None
    """Mean distance of occupied voxels to the surface; None when the map is empty."""
    completeness_m: Distance | None
    """Mean distance of the surface to the nearest occupied voxel."""
    chamfer_m: Distance | None
    """CD-L1: half the sum of accuracy and completeness."""
    num_samples: Annotated[int, Field(ge=0)]
    num_voxels: Annotated[int, Field(ge=0)]
    skipped_instants: Annotated[int, Field(ge=0)] = 0
    """Instants that came too fast to be scored, since start."""
