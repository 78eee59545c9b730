"""What `encircle run` can be told of how the planner knows where the object is."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Metres = Annotated[float, Field(ge=-1e3, le=1e3)]


class TargetFlags(BaseModel):
    """The tracker, and the ground on which the object is looked for without one."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)

    target: Literal["given", "filtered", "map"] = "given"
    """How the planner knows where the object is: given; filtered from a tracker that may be noisy,
    late and blind; map: no tracker at all, found in the map (with frame world)."""
    target_noise_m: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Of the tracker: standard deviation of x and of y, metres."""
    target_noise_rad: Annotated[float, Field(ge=0, le=3)] = 0.0
    """Of the tracker: standard deviation of the heading, radians."""
    target_delay_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Of the tracker: from its shutter to its word, seconds."""
    target_dropout: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Of the tracker: probability that it sees nothing."""
    arena: tuple[Metres, Metres, Metres, Metres] = (-2.4, -2.0, 2.4, 4.0)
    """With target map, the ground that the map covers: least x, least y, greatest x, greatest y,
    metres."""

    @model_validator(mode="after")
    def _a_tracker_is_listened_to(self) -> Self:
        for name in ("target_noise_m", "target_noise_rad", "target_delay_s", "target_dropout"):
            if getattr(self, name) and self.target != "filtered":
                raise ValueError(
                    f"{name} {getattr(self, name)} with target {self.target}: nobody listens to "
                    "the tracker; choose target filtered"
                )
        low_x, low_y, high_x, high_y = self.arena
        if low_x >= high_x or low_y >= high_y:
            raise ValueError(f"arena {self.arena}: each least must be below its greatest")
        return self
