"""Which camera takes which place: as little travel as can be."""

import numpy as np
from numpy.typing import NDArray

from services.kernels.match import match
from services.kernels.rigid import FloatArray
from services.planner.course import Course
from services.planner.planar import wrapped


def assign(costs: FloatArray) -> NDArray[np.int64]:
    """Return (M,) the column of each row, each taken once at most, so that their sum is least.

    Args:
        costs: (M, N), finite, M <= N.
    """
    num_rows, num = costs.shape
    square = np.zeros((num, num))  # Rows beyond M take what is left, whatever it is.
    square[:num_rows] = costs
    columns = np.empty(num, np.int64)
    match(square, columns)
    return columns[:num_rows]


def travel(start: Course, end: Course) -> FloatArray:
    """Return (M, N) squared ways from each start to each end, as flown: around the target.

    Least squares leave no two ways that cross: synchronous straight ways of the best assignment
    stay 1/sqrt(2) of the starts' or ends' distance apart (Turpin, Michael, Kumar, "CAPT", IJRR
    33(1), 2014); the ways are straight in range, azimuth and climb.
    """
    level_m = float(np.mean(np.concatenate([start.level_m, end.level_m])))
    azimuth = wrapped(end.theta_rad[None] - start.theta_rad[:, None])
    ways: FloatArray = (
        (end.range_m[None] - start.range_m[:, None]) ** 2
        + (level_m * azimuth) ** 2
        + (end.climb_m[None] - start.climb_m[:, None]) ** 2
    )
    return ways


def sharpened(ways: FloatArray) -> FloatArray:
    """Return costs whose least sum has a short longest way: that decides how long a change takes.

    Args:
        ways: squared.
    """
    costs: FloatArray = ways**2
    return costs
