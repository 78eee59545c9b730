"""The closed union of tracking controllers."""

from collections.abc import Callable
from functools import partial
from typing import assert_never

from services.camera.controllers.controller import Controller, UnicycleLimits
from services.camera.controllers.dynamic_feedback import DynamicFeedback, DynamicFeedbackGains
from services.camera.controllers.input_output import InputOutputGains, input_output
from services.camera.controllers.kanayama import KanayamaGains, kanayama
from services.camera.controllers.morin_samson import MorinSamsonGains, morin_samson
from services.camera.controllers.planar import Drive, PlanarError, Velocity
from services.camera.controllers.samson import SamsonGains, samson

ControllerGains = (
    KanayamaGains | SamsonGains | MorinSamsonGains | DynamicFeedbackGains | InputOutputGains
)


class Static:
    """A controller without memory: a law, and the limits."""

    def __init__(
        self, law: Callable[[PlanarError, Drive], Velocity], limits: UnicycleLimits
    ) -> None:
        self._law, self._limits = law, limits

    def steer(self, error: PlanarError, reference: Drive, dt_s: float) -> Velocity:  # noqa: ARG002
        """Return the velocity of this instant, within the robot's limits."""
        return self._limits.clipped(self._law(error, reference))


def open_controller(gains: ControllerGains, limits: UnicycleLimits) -> Controller:
    """Build the controller that the gains belong to."""
    match gains:
        case KanayamaGains():
            return Static(partial(kanayama, gains=gains), limits)
        case SamsonGains():
            return Static(partial(samson, gains=gains), limits)
        case MorinSamsonGains():
            return Static(partial(morin_samson, gains=gains), limits)
        case DynamicFeedbackGains():
            return DynamicFeedback(gains, limits)
        case InputOutputGains():
            return Static(partial(input_output, gains=gains), limits)
        case _:
            assert_never(gains)
