"""A frame in the browser: each thing is made once, and then only changed."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from schemas.geometry import Pose
from services.kernels.rigid import FloatArray
from services.viewer.colours import Colours, Rgb
from services.viewer.painting import CLASSES
from services.viewer.primitives import Frame, Frustum, Lines, Points, Surface

if TYPE_CHECKING:
    import viser

_PYRAMID_SCALE = 0.14
_GROUND_M, _FADE_M = 40.0, 14.0
_LIGHT_GRID: tuple[Rgb, Rgb] = (205, 208, 214), (165, 170, 178)
_DARK_GRID: tuple[Rgb, Rgb] = (44, 46, 52), (68, 72, 80)
"""Lines between and around square metres; the ground is to be seen, not to be looked at."""
_WEDGE_COLOUR: Rgb = (86, 150, 230)
_WEDGE_OPACITY = 0.14
_TRUTH_COLOUR: Rgb = (176, 170, 160)


class WebScene:
    """The 3D part of the page.

    A handle is updated in place: made anew, it would flicker, and the browser would have to
    rebuild what it holds on the graphics card.
    """

    def __init__(self, server: "viser.ViserServer") -> None:
        self._scene = server.scene
        self._handles: dict[str, Any] = {}
        self._cameras: dict[int, tuple[float, float]] = {}
        self._world = self._scene.add_frame("/world", show_axes=False)
        self._ground = self._scene.add_grid(
            "/world/ground",
            width=_GROUND_M,
            height=_GROUND_M,
            cell_size=0.25,
            section_size=1.0,
            cell_color=_LIGHT_GRID[0],
            section_color=_LIGHT_GRID[1],
            fade_distance=_FADE_M,
        )

    def draw(self, frame: Frame) -> None:
        """Bring the page's scene to this frame; what the frame lacks is hidden."""
        x, y = frame.middle_m
        self._world.position = (-x, -y, 0.0)
        colours = _DARK_GRID if frame.dark else _LIGHT_GRID
        self._ground.cell_color, self._ground.section_color = colours
        self._points("/world/voxels", frame.voxels, "square", "flat")
        self._points("/world/cloud", frame.cloud, "circle", "flat")
        self._points("/world/ghosts", frame.ghosts, "square", "flat")
        self._surface("/world/wedges", frame.wedges, _WEDGE_COLOUR, _WEDGE_OPACITY)
        self._surface("/world/truth", frame.truth, _TRUTH_COLOUR, None)
        for name, colour in CLASSES.items():
            self._surface(f"/world/coverage/{name}", frame.painted.get(name), colour, None)
        self._lines("/world/rims", frame.rims, 1.2)
        self._lines("/world/formation", frame.formation, 2.5)
        self._lines("/world/path", frame.path, 2.0)
        self._lines("/world/trail", frame.trail, 4.0)
        self._target(frame.target)
        self._frusta(frame.frusta)

    def _handle(self, name: str, shown: bool, make: Callable[[], Any]) -> Any:
        """Return the handle of what is shown, made if need be; None, and hidden, if it is not."""
        handle = self._handles.get(name)
        if not shown:
            if handle is not None:
                handle.visible = False
            return None
        if handle is None:
            handle = self._handles[name] = make()
        handle.visible = True
        return handle

    def _points(self, name: str, points: Points | None, shape: Any, shading: Any) -> None:
        def make() -> Any:
            assert points is not None
            return self._scene.add_point_cloud(
                name,
                points.positions_m,
                points.colours,
                point_size=points.size_m,
                point_shape=shape,
                point_shading=shading,
                precision="float32",
            )

        handle = self._handle(name, points is not None and len(points.positions_m) > 0, make)
        if handle is not None and points is not None:
            handle.points, handle.colors = points.positions_m, points.colours
            handle.point_size = points.size_m
            _place(handle, points.T_world_points)

    def _surface(
        self, name: str, surface: Surface | None, colour: Rgb, opacity: float | None
    ) -> None:
        def make() -> Any:
            assert surface is not None
            return self._scene.add_mesh_simple(
                name,
                surface.vertices_m,
                surface.faces,
                color=colour,
                opacity=opacity,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )

        handle = self._handle(name, surface is not None and len(surface.faces) > 0, make)
        if handle is not None and surface is not None:
            handle.vertices, handle.faces = surface.vertices_m, surface.faces.astype(np.uint32)
            _place(handle, surface.T_world_surface)

    def _lines(self, name: str, lines: Lines | None, thickness_px: float) -> None:
        def make() -> Any:
            assert lines is not None
            return self._scene.add_line_segments(
                name,
                lines.segments_m,
                _linear(lines.colours),
                thickness=thickness_px,
                thickness_units="screen",
            )

        handle = self._handle(name, lines is not None and len(lines.segments_m) > 0, make)
        if handle is not None and lines is not None:
            handle.points, handle.colors = lines.segments_m, _linear(lines.colours)
            _place(handle, lines.T_world_lines)

    def _target(self, T_world_target: FloatArray | None) -> None:
        def make() -> Any:
            return self._scene.add_frame("/world/target", axes_length=0.3, axes_radius=0.004)

        handle = self._handle("/world/target", T_world_target is not None, make)
        if handle is not None and T_world_target is not None:
            _place(handle, T_world_target)

    def _frusta(self, frusta: tuple[Frustum, ...]) -> None:
        shown = {frustum.camera: frustum for frustum in frusta}
        for camera in set(self._cameras) | set(shown):
            self._frustum(camera, shown.get(camera))

    def _frustum(self, camera: int, frustum: Frustum | None) -> None:
        name = f"/world/cameras/{camera}"

        def make() -> Any:
            assert frustum is not None
            self._cameras[camera] = (frustum.vfov_rad, frustum.aspect)
            return self._scene.add_camera_frustum(
                name,
                fov=frustum.vfov_rad,
                aspect=frustum.aspect,
                scale=_PYRAMID_SCALE,
                thickness=2.0,
                thickness_units="screen",
                color=frustum.colour,
                cast_shadow=False,
                receive_shadow=False,
            )

        handle = self._handle(name, frustum is not None, make)
        if handle is not None and frustum is not None:
            handle.fov, handle.aspect = frustum.vfov_rad, frustum.aspect
            _place(handle, frustum.T_world_camera)
            if frustum.image is not None:
                handle.image = frustum.image


def _linear(colours: Colours) -> Colours:
    """Return sRGB as light: of lines, unlike all else, the browser takes colours for that."""
    light: Colours = (255 * (colours / 255) ** 2.2).astype(np.uint8)
    return light


def _place(handle: Any, T: FloatArray) -> None:
    """Put a thing where it is, however far: two valid poses in a row may leave a pose's bounds."""
    x, y, z, w = Pose.from_matrix(_turn(T[:3, :3])).orientation
    handle.position, handle.wxyz = tuple(map(float, T[:3, 3])), (w, x, y, z)


def _turn(R: FloatArray) -> FloatArray:
    """Return the (4, 4) transform that only turns."""
    T = np.eye(4)
    T[:3, :3] = R
    return T
