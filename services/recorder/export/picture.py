"""A moment of a recording, drawn."""

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from schemas.cloud import DepthCloud
from services.kernels.light import Floor, Squares
from services.kernels.palette import linear
from services.kernels.rigid import FloatArray, inverse
from services.recorder.export import props
from services.recorder.export.depth_picture import depth_picture
from services.recorder.export.drawing import Drawing
from services.recorder.export.framing import Frame, middle
from services.recorder.export.moment import Moment
from services.recorder.export.stage import Stage, ViewName
from services.recorder.export.theme import THEMES, ThemeName
from services.recorder.export.voxel_squares import voxel_squares

_VIEW_SHARE = 0.2
"""Length of a drawn view, of the ring's radius."""
_SEEN_FROM_BEHIND = 0.15
"""Opacity of a camera's picture that stands between us and what it looks at."""
_IMAGE_PX = 160
_LINE_PX = 1.5 / 540
"""Width of lines, of the picture's height."""
_FOOT_SHARE = 0.19
_LOOK_UP = 0.1
"""The middle of the picture is so far above the ring's, of its radius: cameras look down."""


class PictureSettings(BaseModel):
    """How a moment is drawn."""

    model_config = ConfigDict(frozen=True)

    width: Annotated[int, Field(ge=64, le=4096)] = 960
    height: Annotated[int, Field(ge=64, le=4096)] = 540
    supersample: Annotated[int, Field(ge=1, le=4)] = 2
    """Drawn so many times larger in each direction, then averaged."""
    theme: ThemeName = "light"
    view: ViewName = "orbit"
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = -90.0
    elevation_deg: Annotated[float, Field(ge=2, le=88)] = 28.0
    zoom: Annotated[float, Field(gt=0.05, le=20)] = 1.0
    follow: bool = True
    """Keep the target in the middle; else the place where it was at first."""
    trail_s: Annotated[float, Field(ge=0, le=3600)] = 4.0
    """How much of the target's way is shown."""
    insets: bool = True
    """Show the cameras' depth images at the picture's foot."""
    caption: bool = True
    """Say time, coverage, F-score and counts."""
    wedges: bool = True
    """Show on the ground what each camera has in view."""
    grid_m: Annotated[float, Field(gt=0, le=1000)] = 0.5
    """Squares of the ground."""


def foot_px(settings: PictureSettings) -> int:
    """Return how many rows at the picture's foot are for the cameras' own pictures."""
    return round(_FOOT_SHARE * settings.height) if settings.insets else 0


class Painter:
    """Draws moments, one after the other; keeps its buffers and the map's faces."""

    def __init__(self, settings: PictureSettings, frame: Frame) -> None:
        self._settings, self._frame = settings, frame
        self._theme = THEMES[settings.theme]
        self._stage = Stage(
            settings.view,
            math.radians(settings.azimuth_deg),
            math.radians(settings.elevation_deg),
            settings.zoom,
        )
        self._drawing = Drawing(
            settings.width, settings.height, settings.supersample, foot_px(settings)
        )
        self._squares: tuple[object, Squares] | None = None

    @property
    def T_world_eye(self) -> FloatArray:
        """(4, 4) from where the last picture was seen."""
        return self._drawing.T_world_eye

    @property
    def intrinsics(self) -> FloatArray:
        """(4,) fx, fy, cx, cy of the picture before it is made smaller."""
        return self._drawing.intrinsics

    def paint(self, moment: Moment, share: float) -> NDArray[np.uint8]:
        """Return the (H, W, 3) picture of a moment; overwritten by the next.

        Args:
            moment: what was known.
            share: how much of the film has gone, 0 to 1.
        """
        frame, settings, drawing = self._frame, self._settings, self._drawing
        centre = middle(moment, frame.centre_m) if settings.follow else frame.centre_m
        squares, size_m = self._map(moment), self._voxel_m(moment)
        look_at_m = centre + np.array([0.0, 0.0, _LOOK_UP * frame.radius_m])
        drawing.begin(
            self._stage.eye(look_at_m, frame.radius_m, share),
            squares,
            size_m,
            self._floor(look_at_m),
            self._theme.mood,
            look_at_m,
            0.8 * frame.radius_m,
        )
        self._views(moment)
        self._lines(moment, size_m)
        return drawing.developed()

    def pictures(self, moment: Moment) -> dict[int, NDArray[np.float64]]:
        """Return the depth images of the newest instant as (h, w, 3) sRGB, by camera."""
        return {
            cloud.camera: depth_picture(cloud, *self._frame.reach_m, _IMAGE_PX)
            for cloud in moment.clouds_of_the_instant()
            if isinstance(cloud, DepthCloud)
        }

    def _views(self, moment: Moment) -> None:
        theme, drawing, radius_m = self._theme, self._drawing, self._frame.radius_m
        size_m, pictures = self._voxel_m(moment), self.pictures(moment)
        for camera, T in self._by_distance(moment):
            cloud, info = moment.clouds.get(camera), moment.infos.get(camera)
            intrinsics = cloud.intrinsics if isinstance(cloud, DepthCloud) else None
            intrinsics = info.intrinsics if info is not None else intrinsics
            if intrinsics is None:
                continue
            wedge = props.wedge_corners(T, intrinsics, 1.25 * radius_m, 1.05 * size_m)
            if wedge is not None and self._settings.wedges:
                drawing.veil(wedge, props.WEDGE_FACES, theme.wedge, theme.wedge_opacity)
            corners = props.view_corners(T, intrinsics, _VIEW_SHARE * radius_m)
            if camera in pictures:
                image = linear(pictures[camera]).astype(np.float32)
                scale = image.shape[1] / intrinsics.width
                k = intrinsics
                K = np.array([k.fx, k.fy, k.cx + 0.5, k.cy + 0.5]) * scale - (0, 0, 0.5, 0.5)
                behind = float(T[:3, 2] @ (drawing.T_world_eye[:3, 3] - corners[1])) < 0.0
                drawing.hang(
                    corners[1:], image, inverse(T), K, _SEEN_FROM_BEHIND if behind else 1.0
                )
            lines = props.view_lines(corners, theme, self._line_px(1.0))
            drawing.lines(*lines, slack_m=0.01 * radius_m)

    def _lines(self, moment: Moment, size_m: float) -> None:
        theme, parts = self._theme, []
        if moment.formation is not None and moment.formation.polygon:
            polygon = moment.formation.polygon
            parts.append(props.polygon_lines(polygon, theme, self._line_px(0.9)))
        trail = [
            each for each in moment.trail if moment.elapsed_s - each[0] <= self._settings.trail_s
        ]
        if len(trail) > 1:
            age = np.array([moment.elapsed_s - t for t, _ in trail])
            places = np.array([place for _, place in trail])
            left = 1.0 - age / max(self._settings.trail_s, 1e-9)
            parts.append(props.trail_lines(places, left, theme, self._line_px(1.6)))
        if moment.T_world_target is not None:
            length_m = 0.35 * self._frame.radius_m
            T = moment.T_world_target
            parts.append(props.heading_lines(T, length_m, theme, self._line_px(1.4)))
        if parts:
            self._drawing.lines(*props.joined(parts), slack_m=1.5 * size_m)

    def _by_distance(self, moment: Moment) -> list[tuple[int, FloatArray]]:
        """Return cameras and poses, the farthest first."""
        eye = self._drawing.T_world_eye[:3, 3]
        poses = moment.poses.items()
        return sorted(poses, key=lambda each: -float(np.linalg.norm(each[1][:3, 3] - eye)))

    def _map(self, moment: Moment) -> Squares:
        latest = moment.mirror.latest
        if self._squares is None or self._squares[0] is not latest:
            squares = voxel_squares(
                moment.mirror, moment.T_world_map, self._frame.top_m, self._theme
            )
            self._squares = (latest, squares)
        return self._squares[1]

    def _voxel_m(self, moment: Moment) -> float:
        latest = moment.mirror.latest
        return 0.01 if latest is None else latest.resolution_m

    def _line_px(self, times: float) -> float:
        return times * max(_LINE_PX * self._settings.height, 0.8)

    def _floor(self, centre_m: FloatArray) -> Floor:
        radius_m = self._frame.radius_m
        return Floor(
            rgb=self._theme.floor,
            line_rgb=self._theme.grid,
            square_m=self._settings.grid_m,
            line_m=0.006 * radius_m,
            centre_m=centre_m[:2].copy(),
            fade_m=np.array([1.3, 3.2]) * radius_m,
        )
