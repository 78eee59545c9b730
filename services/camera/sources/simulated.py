"""Renders what a camera would see of the simulated world."""

from typing import Literal

from schemas.camera import CameraIndex, Intrinsics
from schemas.sim import CameraBody, SceneSpec, SimState
from services.camera.sources.depth_sensor import DepthSensor, DepthSettings
from services.camera.sources.painter import Painter
from services.camera.sources.renderer import Renderer
from services.camera.sources.source import Frame
from services.world.scene import Scene


class SimulatedSettings(DepthSettings):
    """A camera in the simulated world."""

    kind: Literal["simulated"] = "simulated"
    camera: CameraIndex
    seed: int
    intrinsics: Intrinsics
    color: bool
    """Whether pictures will be asked for."""


class SimulatedSource:
    """Sees the scene of `sim/state` from its body's pose.

    Raises:
        MissingExtra: If colour is on and OpenCV is not installed.
    """

    def __init__(self, settings: SimulatedSettings) -> None:
        self._camera = settings.camera
        self._renderer = Renderer(settings.intrinsics, settings.max_range_m)
        self._sensor = DepthSensor(settings, settings.seed, settings.camera)
        self._painter = Painter() if settings.color else None
        self._scene: Scene | None = None

    def prepare(self, scene: SceneSpec) -> None:
        """Load a scene, which is then at hand; see `Source`."""
        Scene.from_spec(scene)

    def capture(self, state: SimState, *, color: bool) -> Frame:
        """Render the instant of `state`, in which this camera must have a body."""
        if self._scene is None or self._scene.spec != state.scene:
            self._scene = Scene.from_spec(state.scene)
        scene = self._scene
        vertices = scene.vertices_world(state.t_ns * 1e-9, state.target.matrix())
        body = body_of(state, self._camera)
        assert body is not None
        T_world_camera = body.pose.matrix()
        self._renderer.draw(vertices, scene.faces, T_world_camera)
        height_m = float(T_world_camera[2, 3])
        depth = self._sensor.report(self._renderer, scene.faces, height_m, state.tick)
        jpeg = None
        if color and self._painter is not None:
            jpeg = self._painter.jpeg(self._renderer, scene, vertices, T_world_camera)
        return Frame(depth, jpeg)


def body_of(state: SimState, camera: int) -> CameraBody | None:
    """Return where the world has a camera; None before it is placed."""
    return next((body for body in state.cameras if body.camera == camera), None)
