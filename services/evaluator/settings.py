"""How the evaluator is told what to do."""

from typing import Annotated

from pydantic import Field

from services.evaluator.truth import NUM_SAMPLES
from services.runtime.settings import ServiceSettings


class EvaluatorSettings(ServiceSettings):
    """Score every map against the true surface of its instant."""

    model_config = ServiceSettings.model_config | {"env_prefix": "ENCIRCLE_EVALUATOR_"}

    samples: Annotated[int, Field(ge=100, le=1_000_000)] = NUM_SAMPLES
    """Points on the true surface."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of those points."""
    radius_m: Annotated[float, Field(gt=0, le=1e3)] = 1.1
    """Distance from the target's centre at which a view is admissible: the formation's."""
