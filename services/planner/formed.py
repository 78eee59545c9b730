"""A formation with its cameras in their places, and where cameras come from that join it."""

from collections.abc import Mapping, Sequence

import numpy as np

from services.kernels.rigid import FloatArray, apply, inverse
from services.planner.motion import Motion, stacked, still
from services.planner.plan import Plan, Strategy
from services.planner.ring import ring_angles
from services.planner.source import Source
from services.planner.spherical import resting
from services.planner.transition import Transition

_PARKED = 1.5
"""Spare cameras wait so many times farther out than any that works."""
_PARKED_RAD = np.pi / 6


class Formed:
    """A strategy's views for its cameras, then the waiting places of the spare ones."""

    def __init__(self, strategy: Strategy, cameras: tuple[int, ...], num_working: int) -> None:
        self._strategy = strategy
        self.cameras = cameras
        """Whose place each view is."""
        self.num_working = num_working
        self._parked: Motion | None = None
        self._last: tuple[Motion, float, Plan] | None = None

    def ordered(self, cameras: tuple[int, ...]) -> "Formed":
        """Return the same places, given to cameras in this order."""
        return Formed(self._strategy, cameras, self.num_working)

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Return what the strategy plans, without the spare cameras."""
        if self._last is None or self._last[0] is not target or self._last[1] != t_s:
            self._last = target, t_s, self._strategy.plan(target, t_s)
        return self._last[2]

    def views(self, target: Motion, t_s: float) -> tuple[Motion, ...]:
        """Return every camera's view in the world."""
        working = self.plan(target, t_s).views
        if len(self.cameras) == self.num_working:
            return working
        return working + target.carry(self._waiting(target, t_s)).each()

    def at(self, target: Motion, t_s: float) -> Motion:
        """Return every camera's view in the frame of the target."""
        return stacked(self.views(target, t_s)).seen_from(target)

    def eyes(self, targets: Sequence[Motion], times_s: Sequence[float]) -> FloatArray:
        """Return (S, N, 3) where the cameras will be; see `Source`."""
        if self._strategy.rests:
            eyes = apply(inverse(targets[0].T), self._eyes(targets[0], times_s[0]))
            return np.broadcast_to(eyes, (len(times_s), *eyes.shape))
        at = zip(targets, times_s, strict=True)
        return np.array([apply(inverse(T.T), self._eyes(T, t_s)) for T, t_s in at])

    def _eyes(self, target: Motion, t_s: float) -> FloatArray:
        views = self._strategy.plan(target, t_s).views
        eyes = np.array([view.T[:3, 3] for view in views])
        if len(self.cameras) == self.num_working:
            return eyes
        waiting = apply(target.T, self._waiting(target, t_s).T[:, :3, 3])
        return np.concatenate([eyes, waiting])

    def _waiting(self, target: Motion, t_s: float) -> Motion:
        if self._parked is None:
            plan, num = self.plan(target, t_s), len(self.cameras) - self.num_working
            eyes = np.array([view.T[:3, 3] for view in plan.views])
            farthest_m = float(np.max(np.linalg.norm(eyes - plan.centre_m, axis=1)))
            places = resting(
                np.full(num, _PARKED * farthest_m), ring_angles(num), np.full(num, _PARKED_RAD)
            )
            self._parked = places.gazing(apply(inverse(target.T), plan.centre_m))
        return self._parked


class Joined:
    """The former references of a formation's cameras; who had none is where it was last seen.

    A camera that nobody has seen begins at its place.
    """

    def __init__(
        self, before: Source | None, seen: Mapping[int, FloatArray], after: Formed
    ) -> None:
        self.cameras = after.cameras
        self.before, self._after = before, after
        former = () if before is None else before.cameras
        rows = range(len(self.cameras))
        self._led = [i for i in rows if self.cameras[i] in former]
        self._former = [former.index(self.cameras[i]) for i in self._led]
        self._held = [i for i in rows if i not in self._led and self.cameras[i] in seen]
        self._poses = np.array([seen[self.cameras[i]] for i in self._held]).reshape(-1, 4, 4)

    @property
    def led(self) -> list[int]:
        """Rows of cameras that had references before."""
        return self._led

    @property
    def unknown(self) -> list[int]:
        """Rows of cameras that are anywhere."""
        known = {*self._led, *self._held}
        return [i for i in range(len(self.cameras)) if i not in known]

    def at(self, target: Motion, t_s: float) -> Motion:
        """Return where each camera was going, frame of the target."""
        if isinstance(self.before, Transition) and self.before.done(t_s):
            self.before = self.before.after
        views = self._after.at(target, t_s)
        T, linear, angular = views.T.copy(), views.linear.copy(), views.angular.copy()
        if self.before is not None and self._led:
            led = self.before.at(target, t_s)
            T[self._led], linear[self._led] = led.T[self._former], led.linear[self._former]
            angular[self._led] = led.angular[self._former]
        if self._held:
            held = still(self._poses).seen_from(target)
            T[self._held], linear[self._held] = held.T, held.linear
            angular[self._held] = held.angular
        return Motion(T, linear, angular)

    def eyes(self, targets: Sequence[Motion], times_s: Sequence[float]) -> FloatArray:
        """Return (S, N, 3) where the cameras will be; see `Source`."""
        eyes = np.empty((len(times_s), len(self.cameras), 3))
        if self.unknown:
            eyes[:] = self._after.eyes(targets, times_s)
        if self.before is not None and self._led:
            eyes[:, self._led] = self.before.eyes(targets, times_s)[:, self._former]
        for row, pose in zip(self._held, self._poses, strict=True):
            eyes[:, row] = [apply(inverse(target.T), pose[:3, 3]) for target in targets]
        return eyes
