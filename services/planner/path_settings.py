"""What the planner is told of the way that the target will take."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from services.planner.known_motion import KnownMotion, PathName, known_path

SemiAxis = Annotated[float, Field(gt=0, le=1000)]


class PathSettings(BaseModel):
    """Flat, as the formation's: environment and flags name each by one word."""

    model_config = ConfigDict(frozen=True)

    path: PathName | None = None
    """What the target drives along, from the origin at time 0; not known if not given."""
    semi_axes_m: tuple[SemiAxis, SemiAxis] = (1.6, 1.2)
    """Half lengths of the known path along x and y."""
    lap_s: Annotated[float, Field(gt=0, le=3600)] = 40.0
    """Time once round the known path."""

    def known_motion(self) -> KnownMotion | None:
        """Return a lap of the known path."""
        if self.path is None:
            return None
        return known_path(self.path, self.semi_axes_m, self.lap_s)
