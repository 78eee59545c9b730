"""Strategy D: at a prescribed scale, robots move along the circle while they must.

Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, case 3. It needs the whole motion
in advance.
"""

from dataclasses import replace

import numpy as np

from services.kernels.rigid import FloatArray
from services.planner.bumps import bump_centres, bump_sum
from services.planner.errors import InfeasibleError
from services.planner.known_motion import KnownMotion, curvature
from services.planner.planar import Slots, robot_references
from services.planner.ring import ring_angles
from services.planner.rules import ROUNDING, Limits
from services.planner.scale_bounds import angle_corridor, edge_bearing

NUM_BUMPS = 200  # N_delta, the article's number.
WIDTHS = np.geomspace(1.0, 50.0, 32)
"""Widths c that are tried, in steps between bumps."""
GAINS = np.linspace(0.9, 4.0, 63)
"""Heights a that are tried; 1 moves as far as the sharpest turn alone would ask."""


def adaptive_angles(motion: KnownMotion, num_cameras: int, d_m: float, limits: Limits) -> Slots:
    """Lift every robot's angle over the bound it would violate, and let it back afterwards.

    theta_i(t) = theta_0i + a sum over b of (theta_i(b) - theta_0i) exp(-(t - b)^2 / (2 c^2)),
    with theta_i(b) the nearest angle that would see the target in the turn at b; a and c of every
    robot make the integral of |theta_0i - theta_i| least.

    Raises:
        InfeasibleError: If no such bumps keep the target in view.
    """
    even = Slots(d_m, ring_angles(num_cameras))
    return even if limits.drive == "flying" else moved(motion, even, limits)


def moved(
    motion: KnownMotion,
    even: Slots,
    limits: Limits,
    widths: FloatArray = WIDTHS,
    gains: FloatArray = GAINS,
) -> Slots:
    """Return a formation of even angles with its robots moved along the circle while they must.

    Args:
        motion: of the target.
        even: the formation; its scale may change.
        limits: to be kept.
        widths: to be tried, in steps between bumps.
        gains: heights to be tried.

    Raises:
        InfeasibleError: If no such bumps keep the target in view.
    """
    theta_0 = even.theta_0_rad
    view = limits.beta_rad - edge_bearing(limits.target_radius_m, even.d_m)
    view = np.broadcast_to(view, motion.t_s.shape)
    period_s = motion.period_s
    centres = bump_centres(motion.t_s, NUM_BUMPS, closed=period_s is not None)
    heights = _asked_for(motion, even, view, centres)
    moves, cost = np.zeros((3, len(motion.t_s), len(theta_0))), np.full(len(theta_0), np.inf)
    cost[~heights.any(axis=0)] = 0.0  # These see it from where they are.
    for width in widths * (centres[1] - centres[0]):
        waves = bump_sum(motion.t_s, centres, heights, float(width), period_s)
        for i in np.flatnonzero(cost > 0):
            wave = waves[:, :, i] * (np.abs(heights[:, i]).max() / np.abs(waves[0, :, i]).max())
            gain = _least_gain(motion, even, view, theta_0[i], wave, gains)
            spent = gain * float(np.abs(wave[0]).sum())
            if spent < cost[i]:
                moves[:, :, i], cost[i] = gain * wave, spent
    if lost := np.flatnonzero(np.isinf(cost)).tolist():
        raise InfeasibleError(
            f"{_named(even)}: |beta_ri| + beta_R <= beta is violated for the camera of "
            f"theta_0 = {np.degrees(theta_0[lost[0]]):.5g} deg, however it moves on the circle"
        )
    return replace(
        even,
        theta_rad=theta_0 + moves[0],
        theta_dot=moves[1],
        theta_ddot=moves[2],
        nominal_rad=theta_0,
    )


def _asked_for(
    motion: KnownMotion, even: Slots, view_rad: FloatArray, centres_s: FloatArray
) -> FloatArray:
    """Return (B, N) the moves that each turn by itself asks for.

    Raises:
        InfeasibleError: If in some turn there is no angle for a camera.
    """
    scales = np.broadcast_to(even.d_m, motion.t_s.shape)
    bends, d_m, view = (
        np.interp(centres_s, motion.t_s, each)
        for each in (curvature(motion.target), scales, view_rad)
    )
    theta_0 = even.theta_0_rad
    lower, upper = angle_corridor(d_m, bends, view, theta_0)
    if lost := np.flatnonzero(~(lower <= upper).all(axis=0)).tolist():
        raise InfeasibleError(
            f"{_named(even)}: |beta_ri| + beta_R <= beta is violated for the camera of "
            f"theta_0 = {np.degrees(theta_0[lost[0]]):.5g} deg, however it moves on the circle"
        )
    moves: FloatArray = np.clip(theta_0, lower, upper) - theta_0
    return moves


def _least_gain(
    motion: KnownMotion,
    even: Slots,
    view_rad: FloatArray,
    theta_0: float,
    wave: FloatArray,
    gains: FloatArray,
) -> float:
    """Return the least height of those tried at which the robot sees the target, or infinity."""
    tried = wave[:, :, None] * gains  # As if every height were a robot of its own.
    slots = replace(
        even,
        theta_rad=theta_0 + tried[0],
        theta_dot=tried[1],
        theta_ddot=tried[2],
        nominal_rad=np.full(len(gains), theta_0),
    )
    bearing = np.abs(robot_references(motion.target, slots).bearing_rad)
    seeing = np.flatnonzero((bearing <= view_rad[:, None] + ROUNDING).all(axis=0))
    return float(gains[seeing[0]]) if len(seeing) else np.inf


def _named(even: Slots) -> str:
    scales = np.atleast_1d(even.d_m)
    return f"adaptive_angles, d = {float(scales.max()):g} m"
