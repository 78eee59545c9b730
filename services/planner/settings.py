"""How the planner is told what to do."""

from typing import Annotated

from pydantic import Field

from services.planner.formation import FormationSettings
from services.planner.limit_settings import LimitSettings
from services.planner.path_settings import PathSettings
from services.planner.target_settings import TargetSettings
from services.runtime.settings import ServiceSettings


class PlannerSettings(
    ServiceSettings, FormationSettings, LimitSettings, TargetSettings, PathSettings
):
    """Plan where the cameras go, from where the target is."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_PLANNER_"}

    dt_s: Annotated[float, Field(gt=0, le=10)] = 1 / 15
    """From one instant to the next: the references are for the next one."""

    def formation(self) -> FormationSettings:
        """Return the part that may change while running."""
        return FormationSettings().changed(
            {name: getattr(self, name) for name in FormationSettings.model_fields}
        )
