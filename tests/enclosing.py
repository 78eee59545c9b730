"""The robots of the literature's example, driven by one of our controllers without a bus.

Lopez-Nicolas, Aranda, Mezouar, T-RO 36(1), 2020: a target on an ellipse, kappa_max = 0.155, and
five robots around it whose cameras see 30 degrees to each side.
"""

import math
from dataclasses import dataclass

import numpy as np

from services.camera.controllers.controller import UnicycleLimits
from services.camera.controllers.delayed import Delayed
from services.camera.controllers.dynamic_feedback import DynamicFeedbackGains
from services.camera.controllers.input_output import InputOutputGains
from services.camera.controllers.kanayama import KanayamaGains
from services.camera.controllers.morin_samson import MorinSamsonGains
from services.camera.controllers.open import open_controller
from services.camera.controllers.planar import Drive, Posture, driven
from services.camera.controllers.samson import SamsonGains
from services.planner.planar import PlanarMotion, Slots, robot_references, wrapped
from services.planner.ring import ring_angles
from services.world.path import Ellipse

DT_S = 0.05
LIMITS = UnicycleLimits(max_speed_mps=1.2, max_turn_rps=0.6)
BETA_RAD = math.radians(30)
KAPPA_MAX = 0.155
PATH = Ellipse(25.0, 12.7, 200.0)
NUM_ROBOTS = 5
ALL_GAINS = {
    "kanayama": KanayamaGains(),
    "samson": SamsonGains(),
    "dynamic_feedback": DynamicFeedbackGains(),
    "morin_samson": MorinSamsonGains(),
    "input_output": InputOutputGains(),
}


def lap(radius_m, duration_s=PATH.period_s):
    """Return references (T, N) of `duration_s` and the target's positions (T, 2)."""
    states = [PATH.at(k * DT_S) for k in range(round(duration_s / DT_S) + 1)]
    rows = [
        (*s.position_m, s.heading_rad, s.v_m_s, s.omega_rad_s, s.v_dot, s.omega_dot) for s in states
    ]
    columns = np.array(rows).T
    target = PlanarMotion(*columns)
    return robot_references(target, Slots(radius_m, ring_angles(NUM_ROBOTS))), columns[:2].T


@dataclass
class Track:
    """What a robot did."""

    error_m: np.ndarray
    bearing_rad: np.ndarray
    velocities: list


def track(references, target_m, robot, gains, *, offset=(0, 0, 0), delay_s=0.0, noise=None):
    """Drive robot `robot` along its references; `noise()` disturbs each measured posture."""
    controller = Delayed(open_controller(gains, LIMITS), delay_s)
    postures = [
        Posture(x, y, phi)
        for x, y, phi in zip(
            references.x_m[:, robot],
            references.y_m[:, robot],
            references.phi_rad[:, robot],
            strict=True,
        )
    ]
    start = postures[0]
    at = Posture(start.x_m + offset[0], start.y_m + offset[1], start.phi_rad + offset[2])
    late = [at] * (round(delay_s / DT_S) + 1)
    error_m, gaze_rad, velocities = [], [], []
    for k, reference in enumerate(postures):
        error_m.append(math.hypot(at.x_m - reference.x_m, at.y_m - reference.y_m))
        dx, dy = target_m[k] - (at.x_m, at.y_m)
        gaze_rad.append(math.atan2(dy, dx) - at.phi_rad - references.psi_rad[robot])
        late = [*late[1:], at]
        seen = late[0]
        if noise is not None:
            dx, dy, dphi = noise()
            seen = Posture(seen.x_m + dx, seen.y_m + dy, seen.phi_rad + dphi)
        drive = Drive(
            references.v_mps[k, robot], references.omega_rps[k, robot], references.v_dot[k, robot]
        )
        velocity = controller.steer(seen, reference, drive, DT_S)
        velocities.append(velocity)
        at = driven(at, velocity, DT_S)
    return Track(np.array(error_m), wrapped(np.array(gaze_rad)), velocities)
