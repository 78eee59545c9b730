"""The baseline: views drawn at random, and drawn anew every so often."""

from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from services.kernels.rigid import FloatArray, apply
from services.planner.ease import ease
from services.planner.motion import Motion
from services.planner.plan import Plan
from services.planner.spherical import Spherical

_TRIES = 32


class RandomSettings(BaseModel):
    """Where views are drawn, in the frame of the target, and how often."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)]
    radius_m: Annotated[float, Field(gt=0)]
    lowest_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    highest_rad: Annotated[float, Field(gt=-np.pi / 2, lt=np.pi / 2)]
    centre_height_m: Annotated[float, Field(ge=0)]
    redraw_s: Annotated[float, Field(gt=0)]
    """From one draw to the next; the flight between them takes all of it."""
    seed: Annotated[int, Field(ge=0)]


class Random:
    """Views even in area over a band of the sphere; flights are smooth and rest at each draw.

    Cameras keep their order around the target, so that their flights do not cross in azimuth.
    """

    rests = False

    def __init__(self, settings: RandomSettings) -> None:
        self._settings = settings
        self._centre = np.array([0.0, 0.0, settings.centre_height_m])

    def plan(self, target: Motion, t_s: float) -> Plan:
        """Carry the cameras, each on its flight from the last draw to the next."""
        settings = self._settings
        epoch, into_s = divmod(max(t_s, 0.0), settings.redraw_s)
        start, end = drawn(settings, int(epoch)), drawn(settings, int(epoch) + 1)
        share, rate = ease(into_s / settings.redraw_s)
        theta, elevation = start + share * (end - start)
        theta_dot, elevation_dot = rate / settings.redraw_s * (end - start)
        rest = np.zeros(settings.cameras)
        places = Spherical(
            rest + settings.radius_m, theta, elevation, rest, theta_dot, elevation_dot
        )
        return Plan(
            views=target.carry(places.gazing(self._centre)).each(),
            centre_m=apply(target.T, self._centre),
            radius_m=settings.radius_m,
            polygon_m=(),
        )


def drawn(settings: RandomSettings, epoch: int) -> FloatArray:
    """Return (2, N) azimuth and elevation of a draw: the best spaced of several."""
    return _drawn(settings.cameras, settings.lowest_rad, settings.highest_rad, settings.seed, epoch)


@lru_cache(maxsize=512)
def _drawn(
    cameras: int, lowest_rad: float, highest_rad: float, seed: int, epoch: int
) -> FloatArray:
    rng = np.random.default_rng(np.random.SeedSequence([seed, epoch]))
    low, high = np.sin(lowest_rad), np.sin(highest_rad)
    draws = np.empty((_TRIES, 2, cameras))
    for draw in draws:
        draw[0] = np.sort(rng.uniform(-np.pi, np.pi, cameras))
        draw[1] = np.arcsin(rng.uniform(low, high, cameras))
    best: FloatArray = draws[np.argmax(_spacing(draws))]
    best.flags.writeable = False
    return best


def _spacing(draws: FloatArray) -> FloatArray:
    """Return (M,) the smallest distance, squared, between two places of each on the unit sphere."""
    theta, elevation = draws.swapaxes(0, 1)
    level = np.cos(elevation)
    points = np.stack([level * np.cos(theta), level * np.sin(theta), np.sin(elevation)], axis=-1)
    squares = np.sum((points[:, :, None] - points[:, None]) ** 2, axis=-1)
    nearest: FloatArray = (squares + 4 * np.eye(theta.shape[1])).min(axis=(1, 2))
    return nearest
