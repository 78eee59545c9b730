"""The pilot of a camera that flies or drives, as it is told."""

from schemas.camera import CameraGoal
from schemas.geometry import Twist
from schemas.sim import CameraBody
from services.camera.pilot import Pilot


class PlannedPilot:
    """Hands each goal to the pilot that it is for: one with a robot is driven, others are flown."""

    def __init__(self, flying: Pilot, driving: Pilot) -> None:
        self._flying, self._driving = flying, driving

    def objection(self, goal: CameraGoal) -> str | None:  # noqa: ARG002
        """Every goal can be followed."""
        return None

    def command(self, body: CameraBody, tick: int, goal: CameraGoal, dt_s: float) -> Twist:
        """Return the velocity for the time from `tick` to the next, world axes."""
        pilot = self._flying if goal.robot is None else self._driving
        return pilot.command(body, tick, goal, dt_s)
