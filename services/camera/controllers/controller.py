"""What a tracking controller of a unicycle is, and the limits that all of them keep."""

from typing import Annotated, Protocol

from pydantic import BaseModel, ConfigDict, Field

from services.camera.controllers.planar import Drive, PlanarError, Velocity

SLOWEST_MPS = 0.1
"""Gains that grow with the reference's speed stay what they are at this speed below it.

So a robot whose reference stops still turns to its heading. It cannot come sideways then: a
unicycle at rest has no smooth feedback that does (Brockett, 1983).
"""

Gain = Annotated[float, Field(gt=0, le=1e3)]


class Gains(BaseModel):
    """Base of every controller's settings."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True, extra="forbid")


class UnicycleLimits(Gains):
    """What a wheeled robot can do."""

    max_speed_mps: Annotated[float, Field(gt=0, le=1e2)] = 1.2
    """Fastest it drives, forwards and backwards, m/s."""
    max_turn_rps: Annotated[float, Field(gt=0, le=1e2)] = 0.6
    """Fastest it turns, rad/s."""

    def clipped(self, velocity: Velocity) -> Velocity:
        """Return the nearest velocity that the robot can drive."""
        return Velocity(
            _within(velocity.v_mps, self.max_speed_mps),
            _within(velocity.omega_rps, self.max_turn_rps),
        )


class Controller(Protocol):
    """Brings a unicycle to its moving reference and keeps it there."""

    def steer(self, error: PlanarError, reference: Drive, dt_s: float) -> Velocity:
        """Return the velocity for the next `dt_s`, within the robot's limits."""
        ...


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
