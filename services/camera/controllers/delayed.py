"""A tracking controller whose robot is told late where it is."""

import math
from collections import deque
from collections.abc import Sequence

from services.camera.controllers.controller import Controller
from services.camera.controllers.planar import Drive, Posture, Velocity, driven, error_of


def predicted(robot: Posture, commands: Sequence[Velocity], delay_s: float, dt_s: float) -> Posture:
    """Return where a robot is `delay_s` after it was measured.

    Args:
        robot: where it was.
        commands: what it was told last, oldest first, `dt_s` each; none before is standing still.
        delay_s: age of the measurement.
        dt_s: between two commands.
    """
    missing_s = delay_s
    steps: list[tuple[Velocity, float]] = []
    for command in reversed(commands):
        if missing_s <= 0.0:
            break
        steps.append((command, min(dt_s, missing_s)))
        missing_s -= dt_s
    for command, step_s in reversed(steps):
        robot = driven(robot, command, step_s)
    return robot


class Delayed:
    """Predicts the robot to the present by what it was told to do, and steers from there."""

    def __init__(self, controller: Controller, delay_s: float) -> None:
        self._controller, self._delay_s = controller, delay_s
        self._commands: deque[Velocity] = deque()

    def steer(self, measured: Posture, reference: Posture, drive: Drive, dt_s: float) -> Velocity:
        """Return the velocity for the next `dt_s`.

        Args:
            measured: where the robot was, `delay_s` ago.
            reference: where it shall be now.
            drive: how the reference drives now.
            dt_s: until the next command.
        """
        robot = predicted(measured, self._commands, self._delay_s, dt_s)
        command = self._controller.steer(error_of(robot, reference), drive, dt_s)
        self._commands.append(command)
        while len(self._commands) > math.ceil(self._delay_s / dt_s):
            self._commands.popleft()
        return command
