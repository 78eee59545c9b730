"""Whether what the cameras are told at an instant can be done, and whether they see the target.

The same rules as those of a plan ahead, for any formation: bearings, distances and velocities are
those of the references themselves. With the target's velocities going on as they are, what holds
for a formation that the target carries holds from then on.
"""

from collections.abc import Sequence

import numpy as np

from schemas.feasibility import Feasibility
from services.kernels.rigid import FloatArray
from services.planner.feasibility import check_tracks
from services.planner.motion import Motion
from services.planner.planar import PlanarMotion
from services.planner.rules import Limits
from services.planner.tracks import tracks_told
from services.planner.wheels import Mounted


def report_on(
    told: Sequence[Mounted], target: Motion, centre_m: FloatArray, limits: Limits
) -> Feasibility:
    """Report on the references of one instant.

    Args:
        told: to one camera or more, world frame.
        target: how it moves, its x axis ahead.
        centre_m: (3,) what of it must be seen, world.
        limits: to be kept.
    """
    return check_tracks(tracks_told([(told, centre_m)]), as_unicycle(target), limits)


def as_unicycle(target: Motion) -> PlanarMotion:
    """Return how a target moves along its x axis and about the vertical."""
    heading_rad = float(np.arctan2(target.T[1, 0], target.T[0, 0]))
    ahead_mps = float(target.linear[:2] @ [np.cos(heading_rad), np.sin(heading_rad)])
    x_m, y_m = target.T[:2, 3].tolist()
    return PlanarMotion(x_m, y_m, heading_rad, ahead_mps, float(target.angular[2]))
