"""How each camera is fixed on its robot, where wheels carry it."""

from collections.abc import Sequence

import numpy as np

from services.kernels.rigid import FloatArray, optical_yaw
from services.planner.assignment import assign
from services.planner.motion import Motion
from services.planner.plan import Plan
from services.planner.planar import wrapped

_M2_PER_RAD2 = 1e3
"""What a place costs that is not the camera's own: more than any way to its own."""


class Mounts:
    """A camera that is fixed on its robot sees the target from one side of it alone."""

    def __init__(self) -> None:
        self._psi_rad: dict[int, float] = {}

    def fixed(self, cameras: Sequence[int], psi_rad: FloatArray) -> FloatArray:
        """Return (N,) how cameras are fixed, from the heading; who is new, as its place wants it.

        Args:
            cameras: in their places.
            psi_rad: (N,) what each place wants; cameras that are new are fixed so from now on.
        """
        for camera, psi in zip(cameras, psi_rad.tolist(), strict=True):
            self._psi_rad.setdefault(camera, psi)
        return np.array([self._psi_rad[camera] for camera in cameras])

    def misfit(self, cameras: Sequence[int], psi_rad: FloatArray) -> FloatArray:
        """Return (M, N) what it costs each camera to be in each place; nothing if it is new.

        Args:
            cameras: M of them.
            psi_rad: (N,) what each place wants.
        """
        costs = np.zeros((len(cameras), len(psi_rad)))
        for row, camera in enumerate(cameras):
            if camera in self._psi_rad:
                costs[row] = _M2_PER_RAD2 * wrapped(psi_rad - self._psi_rad[camera]) ** 2
        return costs


def wanted(plan: Plan, views: Sequence[Motion], target: Motion) -> FloatArray:
    """Return (N,) how a robot must carry its camera in each place, from the heading, rad.

    Such that it looks where its view does while its robot drives parallel to the target, if the
    plan does not say.

    Args:
        plan: of the first places.
        views: of all, world frame.
        target: how it moves, its x axis ahead.
    """
    heading_rad = np.arctan2(target.T[1, 0], target.T[0, 0])
    psi_rad = wrapped(np.array([optical_yaw(view.T) for view in views]) - heading_rad)
    if plan.psi_rad is not None:
        psi_rad[: len(plan.psi_rad)] = plan.psi_rad
    return psi_rad


def fitted(psi_rad: FloatArray, there_rad: FloatArray) -> FloatArray:
    """Return (N,) how the robots in N places carry their cameras, those that are there fitted best.

    Args:
        psi_rad: (N,) what each place wants; who is new is fixed so.
        there_rad: (M,) how those are fixed that there are. If there are more than places, those
            that fit worst are left over.
    """
    num = max(len(psi_rad), len(there_rad))
    costs = np.zeros((num, num))
    costs[: len(there_rad), : len(psi_rad)] = wrapped(psi_rad - there_rad[:, None]) ** 2
    carried = psi_rad.copy()
    for psi, place in zip(there_rad, assign(costs), strict=False):
        if place < len(psi_rad):
            carried[place] = psi
    return carried
