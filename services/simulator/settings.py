"""What is simulated and how its clock runs."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_settings import SettingsConfigDict

from schemas.camera import MAX_CAMERAS
from schemas.sim import SceneSpec
from services.runtime.settings import ServiceSettings
from services.world.deformation import parse_deformations
from services.world.path import Motion, PathKind, open_motion
from services.world.scene import Scene
from services.world.shapes import NAMES

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class SimulatorSettings(ServiceSettings):
    """The simulated world: a target that moves and deforms, and the cameras' bodies."""

    model_config = SettingsConfigDict(env_prefix="ENCIRCLE_SIMULATOR_")

    object: str = "bunny"
    """bunny, sphere, box, torus, or a .obj, .ply, .stl or .off file."""
    up: Literal["auto", "x", "y", "z"] = "auto"
    """Which axis of a mesh file is up; auto: y of .obj and .ply, z of .stl and .off."""
    height_m: Annotated[float, Field(gt=0, le=100)] = 0.4
    """Height of the object, m."""
    subdivide: Annotated[int, Field(ge=0, le=4)] = 2
    """How often the object's triangles are split in four."""
    deformation: str = "rigid"
    """kind[:amplitude[:hz[:phase]]] joined by +: breathing, squash, bend, twist, wave; or rigid."""
    path: PathKind = "ellipse"
    """How the target moves."""
    semi_axes_m: tuple[Positive, Positive] = (1.6, 1.2)
    """Half lengths of the path along x and y, m."""
    lap_s: Positive = 40.0
    """Duration of one lap of the path, s."""
    dt_s: Annotated[float, Field(ge=1e-3, le=1.0)] = 1 / 15
    """Simulated time between two ticks, s."""
    mode: Literal["lockstep", "realtime"] = "lockstep"
    """lockstep waits for everybody at each tick; realtime follows the wall clock."""
    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """Number of cameras in the world; tick 0 waits for all of them."""
    wait_for: tuple[str, ...] = ("planner", "mapper")
    """Which other services tick 0 waits for."""
    timeout_s: Positive = 2.0
    """How long a tick waits before it goes on without those who are missing, s (lockstep)."""
    start_timeout_s: Positive = 10.0
    """The same at tick 0, when links are made and meshes are loaded, s."""
    command_timeout_s: Positive = 0.5
    """After this time without a new command a camera stands still, s (realtime)."""
    max_ticks: Annotated[int, Field(ge=0)] = 0
    """Finish after so many ticks; 0 goes on for ever."""
    duration_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    """Finish after so much simulated time, s; 0 goes on for ever."""
    max_speed_m_s: Positive = 3.0
    """Greatest speed of a camera, m/s."""
    max_turn_rad_s: Positive = 4.0
    """Greatest turn rate of a camera, rad/s."""
    clearance_m: Positive = 0.05
    """Cameras nearer than this to anything are counted as too close, m."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Where all randomness of the simulation comes from."""

    @model_validator(mode="after")
    def _world_can_be_built(self) -> Self:
        Scene.from_spec(self.scene())
        self.motion()
        return self

    def scene(self) -> SceneSpec:
        """Return what all processes need to build the same object."""
        # Other processes may run in another folder.
        known = self.object in NAMES or not Path(self.object).is_file()
        name = self.object if known else str(Path(self.object).resolve())
        return SceneSpec(
            object=name if self.up == "auto" else f"{name}:{self.up}",
            height_m=self.height_m,
            subdivide=self.subdivide,
            deformations=parse_deformations(self.deformation),
            seed=self.seed,
        )

    def motion(self) -> Motion:
        """Return how the target moves."""
        return open_motion(self.path, self.semi_axes_m, self.lap_s)

    @property
    def dt_ns(self) -> int:
        """Duration of a tick in whole nanoseconds, so that time never drifts."""
        return round(self.dt_s * 1e9)

    @property
    def num_ticks(self) -> int | None:
        """How many ticks are run; None for no end."""
        by_time = max(1, round(self.duration_s / self.dt_s)) if self.duration_s else 0
        limits = [n for n in (self.max_ticks, by_time) if n > 0]
        return min(limits, default=None)

    def patience_s(self, tick: int) -> float:
        """Return how long a tick may take in lockstep, s."""
        return self.timeout_s if tick else max(self.timeout_s, self.start_timeout_s)
