"""Rules that courses over a horizon are held against one by one, and the least scale."""

from typing import Protocol

import numpy as np

from services.kernels.courses import pace
from services.kernels.rigid import FloatArray
from services.planner.horizon import BoolArray, Rows, Verify
from services.planner.planar import PlanarMotion
from services.planner.quintic import Course
from services.planner.rules import ROUNDING, Limits
from services.planner.scale_bounds import nearest_chords, separation_scale


class Formation(Protocol):
    """What turns courses into places on the circle."""

    def places(self, course: Course, t_s: FloatArray, rows: Rows) -> tuple[FloatArray, FloatArray]:
        """Return the scale, (3, T), and the angles, (3, T, N), at instants (T,).

        Each with two derivatives; of all N robots if some of the M courses move them all.
        """
        ...


def least_scale(limits: Limits, theta_rad: FloatArray) -> float:
    """Return the scale, m, from which on cameras see, and keep off the target and each other."""
    R = limits.target_radius_m
    near_m = limits.range_min_m + R if limits.range_min_m > 0 else 0.0
    apart_m = separation_scale(limits.robot_distance_m, theta_rad)
    return max(R + limits.robot_radius_m, near_m, apart_m if np.isfinite(apart_m) else 0.0)


def keeps_up(
    limits: Limits, target: PlanarMotion, t_s: FloatArray, formation: Formation
) -> Verify | None:
    """Return what tells which robots can drive a course; None: no limit is set.

    Args:
        limits: to be kept: speed, turn rate and distance of the robots.
        target: at instants (T,).
        t_s: (T,) these instants.
        formation: that makes places of courses.
    """
    if limits.v_max_mps is None and limits.omega_max_rps is None and not limits.robot_distance_m:
        return None
    v_max, omega_max = (
        np.inf if each is None else each + ROUNDING
        for each in (limits.v_max_mps, limits.omega_max_rps)
    )
    motion = np.array([target.v_mps, target.omega_rps, target.v_dot, target.omega_dot], np.float64)

    def verify(course: Course, rows: Rows) -> BoolArray:
        scale, theta = formation.places(course, t_s, rows)
        speed, turn = np.empty((2, *theta.shape[1:]))
        pace(motion, scale, theta, speed, turn)
        if limits.drive == "flying":  # The camera follows its arm.
            turn = motion[1, :, None] + theta[1]
        slow = ((speed <= v_max) & (np.abs(turn) <= omega_max)).all(axis=0)
        can = slow if len(slow) == len(rows) else np.full(len(rows), slow.all())
        if limits.robot_distance_m:
            everyone = np.arange(len(course.value))
            scale, theta = formation.places(course, t_s, everyone)
            apart_m = scale[0] * nearest_chords(theta[0])
            can &= bool((apart_m >= limits.robot_distance_m - ROUNDING).all())
        return can

    return verify
