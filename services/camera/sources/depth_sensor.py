"""What the simulated sensor reports of the true depth."""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from services.camera.sources.renderer import Renderer
from services.kernels.depth_noise import (
    NGUYEN,
    NoiseModel,
    NoisePool,
    add_noise,
    d4xx,
    drop_out,
    mesh_cosines,
    quantise,
)
from services.kernels.edge_jitter import jitter_edges, mark_edges

NoiseKind = Literal["ideal", "nguyen", "d4xx"]
_LARGEST_RAW = 65534  # 65535 is "nothing in range".


class DepthSettings(BaseModel):
    """A simulated depth sensor."""

    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)

    noise: NoiseKind = "nguyen"
    """ideal: rounded only; nguyen: structured light (Kinect); d4xx: stereo (RealSense D4xx)."""
    min_range_m: Annotated[float, Field(ge=0, le=100)] = 0.1
    """What is nearer is invalid, m."""
    max_range_m: Annotated[float, Field(gt=0, le=1000)] = 5.0
    """What is farther does not return, m."""
    depth_scale_m: Annotated[float, Field(gt=0, le=1)] = 0.001
    """One unit of the depth image, m."""
    dropout_share: Annotated[float, Field(ge=0, le=1)] = 0.005
    """Pixels that know nothing for no reason (not if ideal)."""
    baseline_m: Annotated[float, Field(gt=0, le=10)] = 0.05
    """Between the two eyes, m (d4xx)."""
    subpixel_px: Annotated[float, Field(gt=0, le=10)] = 0.1
    """Accuracy of the disparity, px (d4xx)."""

    @model_validator(mode="after")
    def _ranges_fit_the_image(self) -> Self:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"min_range_m {self.min_range_m:g} must be below max_range_m {self.max_range_m:g}"
            )
        if self.max_range_m > _LARGEST_RAW * self.depth_scale_m:
            raise ValueError(
                f"max_range_m {self.max_range_m:g} must be at most {_LARGEST_RAW} * "
                f"depth_scale_m = {_LARGEST_RAW * self.depth_scale_m:g}"
            )
        return self


class DepthSensor:
    """Turns what the renderer drew into a depth image; same seed, camera, tick: same image."""

    def __init__(self, settings: DepthSettings, seed: int, camera: int) -> None:
        self._settings, self._seed, self._camera = settings, seed, camera
        self._ranges = (settings.min_range_m, settings.max_range_m, settings.depth_scale_m)
        self._pool = NoisePool()
        self._cosines: NDArray[np.float32] = np.empty(0, np.float32)
        self._marks: NDArray[np.uint8] = np.empty((0, 0), np.uint8)

    def report(
        self, drawn: Renderer, faces: NDArray[np.int32], camera_height_m: float, tick: int
    ) -> NDArray[np.uint16]:
        """Return a new (H, W) image that spans a bytearray: it reaches shared memory in one copy.

        Args:
            drawn: the true view.
            faces: (F, 3) that it drew.
            camera_height_m: above the ground.
            tick: the instant, which picks the noise.
        """
        shape = drawn.depth_m.shape
        raw = np.frombuffer(bytearray(2 * drawn.depth_m.size), np.uint16).reshape(shape)
        match self._settings.noise:
            case "ideal":
                quantise(drawn.depth_m, *self._ranges, raw)
            case "nguyen":
                self._noisy(NGUYEN, drawn, faces, camera_height_m, tick, raw)
            case "d4xx":
                settings = self._settings
                focal_px = float(drawn.intrinsics[0])
                model = d4xx(focal_px, settings.baseline_m, settings.subpixel_px)
                self._noisy(model, drawn, faces, camera_height_m, tick, raw)
        return raw

    def _noisy(
        self,
        model: NoiseModel,
        drawn: Renderer,
        faces: NDArray[np.int32],
        camera_height_m: float,
        tick: int,
        raw: NDArray[np.uint16],
    ) -> None:
        if len(self._cosines) != len(faces):
            self._cosines = np.empty(len(faces), np.float32)
        mesh_cosines(drawn.vertices_camera_m, faces, self._cosines)
        share = self._settings.dropout_share
        draws = self._pool.draw(raw.shape, share, self._seed, self._camera, tick)
        view = (drawn.depth_m, drawn.triangle, self._cosines, camera_height_m, drawn.intrinsics)
        add_noise(*view, self._ranges, model, draws, raw)
        if model.lateral_px > 0.0:
            if self._marks.shape != raw.shape:
                self._marks = np.empty(raw.shape, np.uint8)
            mark_edges(drawn.depth_m, self._marks)
            jitter_edges(*view, self._ranges, model, draws, self._marks, raw)
        drop_out(draws.salt, raw)
