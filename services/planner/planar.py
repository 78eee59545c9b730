"""Where N robots must drive so that their formation moves with the target: the plane.

Source: Lopez-Nicolas, Aranda, Mezouar, "Adaptive multirobot formation planning to enclose and
track a target with motion and visibility constraints", IEEE T-RO 36(1), 2020, sect. III. Its
eq. (13), as printed, disagrees with differentiation; the angular velocity here is that of z_i.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.kernels.rigid import FloatArray
from services.planner.ring import ring_angles

Series = float | FloatArray
"""One instant, or (T,) instants."""
BoolArray = NDArray[np.bool_]

STANDING_MPS = 1e-9
"""Slower than this a robot stands: its velocity has no direction."""


@dataclass(frozen=True)
class PlanarMotion:
    """The target as a unicycle, world frame; each an instant's number or (T,)."""

    x_m: Series
    y_m: Series
    phi_rad: Series
    """Heading; nothing but its sine and cosine is used."""
    v_mps: Series
    omega_rps: Series
    v_dot: Series = 0.0
    """m/s^2."""
    omega_dot: Series = 0.0
    """rad/s^2."""


@dataclass(frozen=True)
class Slots:
    """Places on the circle about the target, in its frame, and how they change."""

    d_m: Series
    """Scale: distance of every robot from the target."""
    theta_rad: FloatArray
    """(N,) or (T, N) angles on the circle; not headings."""
    d_dot: Series = 0.0
    d_ddot: Series = 0.0
    theta_dot: float | FloatArray = 0.0
    theta_ddot: float | FloatArray = 0.0
    nominal_rad: FloatArray | None = None
    """(N,) theta_0i for which the cameras are mounted; the regular polygon if not given."""

    @property
    def theta_0_rad(self) -> FloatArray:
        """(N,) angles at which a camera sees the target centrally on a straight line."""
        if self.nominal_rad is None:
            return ring_angles(np.asarray(self.theta_rad).shape[-1])
        return self.nominal_rad


@dataclass(frozen=True)
class RobotReferences:
    """What every robot must do, world frame; arrays (N,) or (T, N)."""

    x_m: FloatArray
    y_m: FloatArray
    phi_rad: FloatArray
    """Heading phi_ri of the robot, (-pi, pi]."""
    v_mps: FloatArray
    """Speed along the heading; negative where the target reverses, for then they all do."""
    omega_rps: FloatArray
    v_dot: FloatArray
    """Its derivative, m/s^2."""
    bearing_rad: FloatArray
    """beta_ri: where the camera sees the target, off its axis, (-pi, pi]."""
    psi_rad: FloatArray
    """(N,) yaw of the camera on its robot."""
    standing: BoolArray
    """Where the robot has no velocity: its heading is the one it had, omega is 0."""


def robot_references(
    target: PlanarMotion, slots: Slots, kept_phi_rad: FloatArray | None = None
) -> RobotReferences:
    """Return position, heading and velocities of all robots of a formation.

    Args:
        target: one instant or T of them.
        slots: of N robots; of one instant, of T, or constant.
        kept_phi_rad: (N,) headings before the first instant, for robots that stand in it; the
            target's heading if not given.

    Source: sect. 2 and eq. (12) of the article, with z_i the velocity of robot i in the frame of
    the target as a complex number.
    """
    phi, v, omega, v_dot, omega_dot = map(
        _column,
        (target.phi_rad, target.v_mps, target.omega_rps, target.v_dot, target.omega_dot),
    )
    d, d_dot, d_ddot = map(_column, (slots.d_m, slots.d_dot, slots.d_ddot))
    theta, theta_dot = np.asarray(slots.theta_rad), np.asarray(slots.theta_dot)
    arm = np.exp(1j * theta)

    # The velocity of a robot in the frame of the target, and its derivative in that frame.
    turn, turn_dot = omega + theta_dot, omega_dot + np.asarray(slots.theta_ddot)
    swing = d_dot + 1j * d * turn
    z = v + swing * arm
    z_dot = v_dot + (d_ddot + 1j * (d_dot * turn + d * turn_dot) + 1j * theta_dot * swing) * arm

    # Along its heading, eq. (12); backwards when the target drives backwards.
    speed = np.abs(z)
    standing = speed < STANDING_MPS
    ahead = np.where(v < 0, -1.0, 1.0)
    phi_r = _kept(phi + np.angle(ahead * z), standing, kept_phi_rad)
    safe = np.where(standing, 1.0, speed)
    along = np.where(standing, 0.0, np.conj(z) * z_dot)

    theta_0 = slots.theta_0_rad
    place = d * np.exp(1j * (phi + theta))
    return RobotReferences(
        x_m=_column(target.x_m) + place.real,
        y_m=_column(target.y_m) + place.imag,
        phi_rad=wrapped(phi_r),
        v_mps=np.where(standing, 0.0, ahead * speed),
        omega_rps=np.where(standing, 0.0, omega + along.imag / safe**2),
        v_dot=ahead * along.real / safe,
        bearing_rad=wrapped(phi + theta - phi_r - theta_0),
        psi_rad=yaw_offsets(theta_0),
        standing=standing,
    )


def yaw_offsets(theta_0_rad: FloatArray) -> FloatArray:
    """Return (N,) psi_i: how the cameras are turned on robots that drive parallel to the target."""
    return wrapped(theta_0_rad + np.pi)


def wrapped(angle_rad: FloatArray) -> FloatArray:
    """Return the same angles in (-pi, pi]."""
    turned: FloatArray = np.pi - np.mod(np.pi - np.asarray(angle_rad), 2 * np.pi)
    return turned


def _column(value: Series) -> FloatArray:
    """Return one instant as (1,), T instants as (T, 1): broadcasts over robots."""
    return np.asarray(value, np.float64)[..., None]


def _kept(phi_r: FloatArray, standing: BoolArray, before: FloatArray | None) -> FloatArray:
    """Replace headings of robots that stand by the last they had."""
    if not standing.any():
        return phi_r
    kept: FloatArray = phi_r if before is None else np.where(standing, before, phi_r)
    if kept.ndim == 1:
        return kept
    moving = np.where(standing, 0, np.arange(len(kept))[:, None])
    last = np.maximum.accumulate(moving, axis=0)
    return np.take_along_axis(kept, last, axis=0)
