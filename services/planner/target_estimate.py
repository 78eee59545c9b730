"""What is believed of the target, as a message and as a motion."""

import math
from collections.abc import Callable

import numpy as np

from schemas.geometry import WORLD, Pose, Twist
from schemas.message import Message
from schemas.target import Sighting, TargetEstimate
from services.kernels.rigid import planar
from services.planner.motion import Motion, still
from services.planner.target_filter import Fix, motion_of
from services.planner.target_settings import TargetSettings
from services.planner.turn_model import PHI, Belief, X, Y

Aim = Callable[[Message, Motion], None]
"""Told an instant (its `t_ns` and `tick`) and the target's motion at the next one."""


def estimate_of(stamp: Message, belief: Belief, used: int, refused: int, missed: int) -> Message:
    """Return the message of what is believed of an instant, and what it rests on."""
    motion = motion_of(belief)
    return TargetEstimate(
        t_ns=stamp.t_ns,
        tick=stamp.tick,
        frame_id=WORLD,
        pose=Pose.from_matrix(motion.T),
        twist=Twist(linear=tuple(motion.linear.tolist()), angular=tuple(motion.angular.tolist())),
        sigma_m=math.sqrt((belief.cov[X, X] + belief.cov[Y, Y]) / 2),
        sigma_rad=min(math.sqrt(belief.cov[PHI, PHI]), math.pi),
        num_used=used,
        num_refused=refused,
        num_missed=missed,
    )


def guess(settings: TargetSettings) -> Motion:
    """Return where the target is taken to stand before anything was seen of it."""
    return still(planar(*settings.guess_m, math.radians(settings.guess_deg)))


def fix_of(sighting: Sighting) -> Fix:
    """Return what the filter takes in of a tracker's measurement: the target is on the ground."""
    T = sighting.pose.matrix()
    return Fix(
        t_ns=sighting.t_ns,
        x_m=float(T[0, 3]),
        y_m=float(T[1, 3]),
        sigma_m=sighting.sigma_m,
        phi_rad=float(np.arctan2(T[1, 0], T[0, 0])),
        sigma_rad=sighting.sigma_rad,
    )
