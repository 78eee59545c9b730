"""Courses of least jerk, and how robots must drive that follow them on a circle.

A course is a column of (9, M): start s, value, rate, second derivative, goal, safe value, duration
of the move to the goal, when the goal is left, duration of the move back; see `planner/quintic.py`.
"""

import numpy as np
from numba import njit

_STANDING_MPS = 1e-9
"""As in `planner/planar.py`: slower than this a robot stands, its velocity has no direction."""


@njit(cache=True, error_model="numpy", nogil=True)
def follow(courses, t, moved):  # type: ignore[no-untyped-def]
    """Write where M courses are at T instants.

    Args:
        courses: (9, M)
        t: (T,) s.
        moved: (3, T, M) values, rates, second derivatives; written.
    """
    for m in range(courses.shape[1]):
        start, value, rate, push, goal, safe, move, leave, back = courses[:, m]
        for k in range(len(t)):
            s = min(max((t[k] - start) / move, 0.0), 1.0)
            s2, left = s * s, 1.0 - s
            l3 = left * left * left
            moved[0, k, m] = (
                goal
                + l3 * (1.0 + 3.0 * s + 6.0 * s2) * (value - goal)
                + move * l3 * (s + 3.0 * s2) * rate
                + move**2 / 2.0 * l3 * s2 * push
            )
            moved[1, k, m] = (
                -30.0 * s2 * left**2 / move * (value - goal)
                + (1.0 + s2 * (-18.0 + s * (32.0 - 15.0 * s))) * rate
                + move * s * (1.0 + s * (-4.5 + s * (6.0 - 2.5 * s))) * push
            )
            moved[2, k, m] = (
                -60.0 * s * left * (1.0 - 2.0 * s) / move**2 * (value - goal)
                + s * (-36.0 + s * (96.0 - 60.0 * s)) / move * rate
                + (1.0 + s * (-9.0 + s * (18.0 - 10.0 * s))) * push
            )
            s = min(max((t[k] - start - leave) / back, 0.0), 1.0)
            left = 1.0 - s
            way = safe - goal
            moved[0, k, m] += way * s * s * s * (10.0 + s * (-15.0 + 6.0 * s))
            moved[1, k, m] += way * 30.0 * s * s * left * left / back
            moved[2, k, m] += way * 60.0 * s * left * (1.0 - 2.0 * s) / back**2


@njit(cache=True, error_model="numpy", nogil=True)
def pace(target, scale, theta, speed, turn):  # type: ignore[no-untyped-def]
    """Write how fast robots must drive and turn; both 0 where one stands.

    Args:
        target: (4, T) v, omega and their derivatives.
        scale: (3, T) d with two derivatives, m.
        theta: (3, T, N) angles on the circle with two derivatives.
        speed: (T, N) m/s, not negative; written.
        turn: (T, N) omega_ri, rad/s; written.

    Source: Lopez-Nicolas, Aranda, Mezouar, IEEE T-RO 36(1), 2020, eqs. (8), (12); see
    `planner/planar.py`, its slow twin.
    """
    for k in range(target.shape[1]):
        v, omega, v_dot, omega_dot = target[:, k]
        d, d_dot, d_ddot = scale[:, k]
        for i in range(theta.shape[2]):
            theta_dot = theta[1, k, i]
            spin, spin_dot = omega + theta_dot, omega_dot + theta[2, k, i]
            arm = complex(np.cos(theta[0, k, i]), np.sin(theta[0, k, i]))
            swing = complex(d_dot, d * spin)
            z = v + swing * arm
            z_dot = v_dot + arm * (
                complex(d_ddot, d_dot * spin + d * spin_dot) + 1j * theta_dot * swing
            )
            speed[k, i], turn[k, i] = abs(z), 0.0
            if speed[k, i] < _STANDING_MPS:
                speed[k, i] = 0.0
            else:
                turn[k, i] = omega + (z.conjugate() * z_dot).imag / speed[k, i] ** 2
