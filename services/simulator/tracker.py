"""A simulated tracker: the target's pose with noise, late, and sometimes not at all."""

from dataclasses import dataclass

import numpy as np

from schemas.geometry import WORLD, Pose
from schemas.target import Sighting, TargetObservation
from services.kernels.rigid import planar
from services.world.path import Motion

_STREAM = 0x7261636B  # Sets its random numbers apart from the cameras', whose seed is the same.


@dataclass(frozen=True)
class Tracker:
    """What is said depends on the seed and the time alone, so that telling it twice is telling it.

    The target stands at its start before the clock runs: until `delay_ns` has passed the tracker
    tells, again and again, what it saw of it at time 0.
    """

    noise_m: float
    noise_rad: float
    delay_ns: int
    dropout: float
    """Probability that a measurement is lost."""
    seed: int

    def observation(self, motion: Motion, tick: int, t_ns: int) -> TargetObservation:
        """Return what the tracker says at `t_ns`: the pose of `delay_ns` before, or nothing."""
        return TargetObservation(
            t_ns=t_ns,
            tick=tick,
            frame_id=WORLD,
            sighting=self._sighting(motion, max(t_ns - self.delay_ns, 0)),
        )

    def _sighting(self, motion: Motion, t_ns: int) -> Sighting | None:
        random = np.random.default_rng(np.random.SeedSequence([_STREAM, self.seed, t_ns]))
        if random.random() < self.dropout:
            return None
        dx, dy, turn = random.standard_normal(3)
        truth = motion.at(t_ns * 1e-9)
        x, y = truth.position_m
        pose = planar(
            x + self.noise_m * dx,
            y + self.noise_m * dy,
            truth.heading_rad + self.noise_rad * turn,
        )
        return Sighting(
            t_ns=t_ns,
            pose=Pose.from_matrix(pose),
            sigma_m=self.noise_m,
            sigma_rad=self.noise_rad,
        )
