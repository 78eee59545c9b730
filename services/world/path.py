"""Where the target goes: closed-form unicycle motions on the ground.

Every motion starts at the world's origin and, but for the figure eight, heads along x. The
ellipse is that of "Multi-camera architecture for perception strategies": x = a sin(tau),
y = b (1 - cos(tau)), tau = 2 pi t / lap. Its parameter is an angle, hence its speed is *not*
constant: it varies between 2 pi b / lap and 2 pi a / lap.
"""

import math
from dataclasses import dataclass
from typing import Literal, Protocol, assert_never, get_args

from services.kernels.rigid import FloatArray, planar
from services.world.errors import PathError

PathKind = Literal["ellipse", "line", "circle", "eight", "static"]
PATHS: tuple[str, ...] = get_args(PathKind)


@dataclass(frozen=True)
class Unicycle:
    """A unicycle's state at one instant: x' = v cos(heading), y' = v sin, heading' = omega."""

    position_m: tuple[float, float]
    heading_rad: float
    """In (-pi, pi]."""
    v_m_s: float
    omega_rad_s: float
    v_dot: float
    """m/s^2."""
    omega_dot: float
    """rad/s^2."""

    def pose(self) -> FloatArray:
        """Return (4, 4) T_world_target."""
        return planar(*self.position_m, self.heading_rad)

    def twist(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return the linear (m/s) and angular (rad/s) velocity in world axes."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return (self.v_m_s * c, self.v_m_s * s, 0.0), (0.0, 0.0, self.omega_rad_s)


class Motion(Protocol):
    """A motion known in closed form at every time."""

    @property
    def period_s(self) -> float:
        """Duration of one lap."""

    def at(self, t_s: float) -> Unicycle:
        """Return the state at simulated time `t_s`."""


@dataclass(frozen=True)
class Static:
    """Stands at the origin and looks along x."""

    period_s: float

    def at(self, t_s: float) -> Unicycle:  # noqa: ARG002  It is the same at all times.
        return Unicycle((0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Line:
    """Goes along x at constant speed, `length_m` in a lap, and does not turn back."""

    length_m: float
    period_s: float

    def at(self, t_s: float) -> Unicycle:
        v = self.length_m / self.period_s
        return Unicycle((v * t_s, 0.0), 0.0, v, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Ellipse:
    """Goes anticlockwise around an ellipse whose lowest point is the origin; a circle if a = b."""

    a_m: float
    """Semi-axis along x."""
    b_m: float
    """Semi-axis along y."""
    period_s: float

    def at(self, t_s: float) -> Unicycle:
        n = 2 * math.pi / self.period_s
        s, c = math.sin(n * t_s), math.cos(n * t_s)
        a, b = self.a_m, self.b_m
        return _on_curve(
            (a * s, b * (1 - c)),
            (a * n * c, b * n * s),
            (-a * n**2 * s, b * n**2 * c),
            (-a * n**3 * c, -b * n**3 * s),
        )


@dataclass(frozen=True)
class Eight:
    """Goes along Gerono's figure eight, crossing the origin twice in a lap."""

    a_m: float
    """Half of its length along x."""
    b_m: float
    """Half of its width along y."""
    period_s: float

    def at(self, t_s: float) -> Unicycle:
        n = 2 * math.pi / self.period_s
        s, c = math.sin(n * t_s), math.cos(n * t_s)
        s2, c2 = math.sin(2 * n * t_s), math.cos(2 * n * t_s)
        a, b = self.a_m, self.b_m
        return _on_curve(
            (a * s, b * s2),
            (a * n * c, 2 * b * n * c2),
            (-a * n**2 * s, -4 * b * n**2 * s2),
            (-a * n**3 * c, -8 * b * n**3 * c2),
        )


def open_motion(kind: PathKind, semi_axes_m: tuple[float, float], lap_s: float) -> Motion:
    """Open a motion by name.

    Args:
        kind: one of `PATHS`.
        semi_axes_m: half lengths along x and y; a circle takes the first as radius, a line is
            twice the first per lap.
        lap_s: duration of one lap.

    Raises:
        PathError: If the kind is unknown or a measure is not positive.
    """
    if not all(math.isfinite(m) and m > 0 for m in (*semi_axes_m, lap_s)):
        raise PathError(f"semi-axes {semi_axes_m} m and lap {lap_s} s must all be positive")
    a, b = semi_axes_m
    match kind:
        case "ellipse":
            return Ellipse(a, b, lap_s)
        case "circle":
            return Ellipse(a, a, lap_s)
        case "line":
            return Line(2 * a, lap_s)
        case "eight":
            return Eight(a, b, lap_s)
        case "static":
            return Static(lap_s)
        case _:
            assert_never(kind)


_Pair = tuple[float, float]


def _on_curve(p: _Pair, d1: _Pair, d2: _Pair, d3: _Pair) -> Unicycle:
    """Turn a curve's point and its first three time derivatives into a unicycle's state."""
    v = math.hypot(*d1)
    v_dot = (d1[0] * d2[0] + d1[1] * d2[1]) / v
    omega = (d1[0] * d2[1] - d1[1] * d2[0]) / v**2
    omega_dot = (d1[0] * d3[1] - d1[1] * d3[0]) / v**2 - 2 * omega * v_dot / v
    return Unicycle(p, math.atan2(d1[1], d1[0]), v, omega, v_dot, omega_dot)
