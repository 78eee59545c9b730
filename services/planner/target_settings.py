"""How the planner knows where the target is."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from services.planner.turn_model import Agility

TargetMode = Literal["given", "filtered", "map"]
Place = Annotated[float, Field(ge=-1e4, le=1e4)]


class TargetSettings(BaseModel):
    """Flat, as the formation's: environment and flags name each by one word."""

    model_config = ConfigDict(frozen=True)

    target: TargetMode = "given"
    """given: target/pose is believed; filtered: estimated from target/observation, which may be
    noisy, late or missing; map: no pose at all, estimated from the map (mapper: frame world)."""
    agility: Annotated[float, Field(gt=0, le=100)] = 0.1
    """How much its speed changes by chance, m/s^2 per sqrt(Hz); filtered and map."""
    turn_agility: Annotated[float, Field(gt=0, le=100)] = 0.2
    """The same of its turn rate, rad/s^2 per sqrt(Hz)."""
    bridge_s: Annotated[float, Field(gt=0, le=60)] = 1.0
    """So long it is believed to go on as it did when nothing is seen of it; then to stand."""
    guess_m: tuple[Place, Place] = (0.0, 0.0)
    """Where the cameras look before anything was seen of it: x and y in the world."""
    guess_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """Its heading then."""
    ground_m: Annotated[float, Field(ge=-100, le=100)] = 0.05
    """What the map has below this height is the ground, not the target; map."""
    reach_m: Annotated[float, Field(gt=0, le=1e3)] = 0.8
    """What is farther than this from where the target is expected is something else; map."""
    map_sigma_m: Annotated[float, Field(gt=0, le=10)] = 0.02
    """Standard deviation of the target's place as the map shows it; map."""

    def target_agility(self) -> Agility:
        """Return what the filter is told of the target."""
        return Agility(self.agility, self.turn_agility)
