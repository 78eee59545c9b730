"""All cameras of a formation at every instant, and how they see their target."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from services.kernels.rigid import FloatArray, apply
from services.planner.known_motion import KnownMotion
from services.planner.motion import Motion, stacked
from services.planner.plan import Strategy
from services.planner.planar import PlanarMotion, Slots, robot_references
from services.planner.rules import Limits
from services.planner.scale_bounds import edge_bearing
from services.planner.spherical import resting
from services.planner.wheels import Carrier, Mounted

_AT_THE_CENTRE_M = 1e-9
"""A camera nearer than this to the target's centre is reported and not divided by."""


@dataclass(frozen=True)
class Tracks:
    """N cameras at T instants, world frame."""

    views: Motion
    """(T, N, 4, 4), (T, N, 3): T_world_camera, optical, and its velocities."""
    centre_m: FloatArray
    """(T, 3) what they shall see."""
    v_mps: FloatArray
    """(T, N) speed; of a robot with wheels along its heading, negative in reverse."""
    heading_rad: FloatArray
    """(T, N) where the robot heads; of a camera that flies, where it looks from above."""

    @property
    def eyes_m(self) -> FloatArray:
        """(T, N, 3) where the cameras are."""
        return self.views.T[..., :3, 3]

    @property
    def range_m(self) -> FloatArray:
        """(T, N) distances from the target's centre."""
        arms: FloatArray = np.linalg.norm(self.eyes_m - self.centre_m[:, None], axis=-1)
        return arms

    @property
    def turning_rps(self) -> FloatArray:
        """(T, N) how fast the cameras turn."""
        rates: FloatArray = np.linalg.norm(self.views.angular, axis=-1)
        return rates

    @property
    def nearest_m(self) -> FloatArray:
        """(T,) distance between the nearest two cameras; infinite for one."""
        apart = np.linalg.norm(self.eyes_m[:, :, None] - self.eyes_m[:, None], axis=-1)
        pairs = np.triu_indices(apart.shape[1], 1)
        nearest: FloatArray = apart[:, *pairs].min(axis=1, initial=np.inf)
        return nearest


@dataclass(frozen=True)
class Sight:
    """Where T x N cameras see the target, rad."""

    bearing_rad: FloatArray
    """Its centre left of the axis, as in the article: against the clock from above."""
    rise_rad: FloatArray
    """Its centre above the axis."""
    edge_rad: FloatArray
    """From its centre to its edge, sideways."""
    edge_up_rad: FloatArray
    """The same upwards."""


def sight_of(tracks: Tracks, target_radius_m: float) -> Sight:
    """Return where cameras see a ball about the centre.

    It is in view up to the plane through the camera's eye and a side of its image, if its centre is
    a radius away from that plane.
    """
    ways = tracks.centre_m[:, None] - tracks.eyes_m
    right, down, ahead = np.einsum("tnij,tni->jtn", tracks.views.T[..., :3, :3], ways)

    def edge(aside: FloatArray) -> FloatArray:
        return edge_bearing(target_radius_m, np.maximum(np.hypot(aside, ahead), _AT_THE_CENTRE_M))

    return Sight(np.arctan2(-right, ahead), -np.arctan2(down, ahead), edge(right), edge(down))


def edges_off(sight: Sight) -> tuple[FloatArray, FloatArray]:
    """Return (T, N) how far the target's edge is off the axis, sideways and upwards, rad."""
    excess: FloatArray = np.abs(sight.bearing_rad) + sight.edge_rad
    rise: FloatArray = np.abs(sight.rise_rad) + sight.edge_up_rad
    return excess, rise


def tracks_along(
    strategy: Strategy, carrier: Carrier, motion: KnownMotion, centre_height_m: float
) -> Tracks:
    """Return what cameras are told along a motion, instant by instant, as the planner does it.

    Args:
        strategy: whose views they take.
        carrier: what takes them there.
        motion: of the target.
        centre_height_m: of its centre above the ground.
    """
    instants = []
    for target, t_s in zip(spatial(motion.target).each(), motion.t_s.tolist(), strict=True):
        plan = strategy.plan(target, t_s)
        views = plan.views
        mounted = carrier.carry(range(len(views)), views, target, t_s, plan.psi_rad)
        instants.append((mounted, apply(target.T, [0.0, 0.0, centre_height_m])))
    return tracks_told(instants)


def tracks_told(instants: Sequence[tuple[Sequence[Mounted], FloatArray]]) -> Tracks:
    """Put together what cameras are told at T instants, each with the centre (3,) that they see."""
    rows = [stacked([each.view for each in mounted]) for mounted, _ in instants]
    views = Motion(
        np.array([row.T for row in rows]),
        np.array([row.linear for row in rows]),
        np.array([row.angular for row in rows]),
    )
    robots = [[each.robot for each in mounted] for mounted, _ in instants]
    speed = np.linalg.norm(views.linear, axis=-1)
    gaze = np.arctan2(views.T[..., 1, 2], views.T[..., 0, 2])
    for k, row in enumerate(robots):
        for i, robot in enumerate(row):
            if robot is not None:
                speed[k, i], gaze[k, i] = robot.v_mps, robot.heading_rad
    return Tracks(views, np.array([centre for _, centre in instants]), speed, gaze)


def tracks_of(
    motion: KnownMotion, slots: Slots, limits: Limits, centre_height_m: float = 0.0
) -> Tracks:
    """Return the cameras of places on a circle about the target; see `robot_references`."""
    references = robot_references(motion.target, slots)
    shape, target = references.x_m.shape, motion.target
    phi, omega = (np.asarray(each)[:, None] for each in (target.phi_rad, target.omega_rps))
    level_m, rate = (np.asarray(each)[..., None] for each in (slots.d_m, slots.d_dot))
    climb = np.tan(limits.elevation_rad)
    centre = np.stack([target.x_m, target.y_m, np.full_like(motion.t_s, centre_height_m)], -1)
    views = resting(
        np.broadcast_to(level_m / np.cos(limits.elevation_rad), shape),
        phi + slots.theta_rad,
        np.full(shape, limits.elevation_rad),
    ).gazing(centre[:, None])
    heading = np.broadcast_to(references.phi_rad, shape)
    T, turning = views.T, np.broadcast_to(omega + slots.theta_dot, shape)
    if limits.drive == "unicycle":
        T = T.copy()
        T[..., :3, :3] = _about_up(-references.bearing_rad) @ T[..., :3, :3]
        turning = references.omega_rps
    v_mps = np.broadcast_to(references.v_mps, shape)
    up = np.broadcast_to(rate * climb, shape)
    linear = np.stack([v_mps * np.cos(heading), v_mps * np.sin(heading), up], axis=-1)
    return Tracks(Motion(T, linear, turning[..., None] * [0.0, 0.0, 1.0]), centre, v_mps, heading)


def spatial(target: PlanarMotion) -> Motion:
    """Return a unicycle's motion, (T, 4, 4), on the ground."""
    phi = np.asarray(target.phi_rad)
    c, s = np.cos(phi), np.sin(phi)
    T = np.zeros((*phi.shape, 4, 4))
    T[..., :3, :3] = _about_up(phi)
    T[..., 0, 3], T[..., 1, 3], T[..., 3, 3] = target.x_m, target.y_m, 1.0
    ahead = np.stack([c, s, np.zeros_like(c)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    return Motion(
        T, np.asarray(target.v_mps)[..., None] * ahead, np.asarray(target.omega_rps)[..., None] * up
    )


def _about_up(angle_rad: FloatArray) -> FloatArray:
    """Return rotations (..., 3, 3) about the vertical."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    R = np.zeros((*np.shape(angle_rad), 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 1, 0], R[..., 1, 1], R[..., 2, 2] = c, -s, s, c, 1.0
    return R
