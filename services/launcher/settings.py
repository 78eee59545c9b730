"""What `encircle run` can be told; default < scenario < environment < flag."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from schemas.camera import MAX_CAMERAS, MAX_SIDE_PX
from services.launcher.arena import refuse_what_leaves
from services.launcher.strategy_flags import StrategyFlags
from services.launcher.target_flags import TargetFlags

ENV_PREFIX = "ENCIRCLE_RUN_"
RUNS_OWN = Path(".")
"""Stands for the run's folder."""
MAP_SUFFIXES = (".npz", ".ply", ".bt", ".ot", ".obj", ".glb")
"""What the mapper writes; here because the mapper takes a second to import."""
SemiAxis = Annotated[float, Field(gt=0, le=1000)]
_RESOLUTION = re.compile(r"(\d{1,5})x(\d{1,5})")


class RunSettings(TargetFlags, StrategyFlags):
    """Run the whole chain: simulator, cameras, planner, mapper, evaluator."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    scenario: Path | None = None
    """TOML file whose keys are these flags, with `_` for `-`."""

    object: str = "bunny"
    """bunny, sphere, box, torus, or a mesh file (.obj .ply .stl .off)."""
    up: Literal["auto", "x", "y", "z"] = "auto"
    """Which axis of a mesh file is up."""
    height: Annotated[float, Field(gt=0, le=100)] = 0.4
    """Height of the object, metres."""
    path: Literal["ellipse", "circle", "line", "eight", "static"] = "ellipse"
    """What the object drives along."""
    lap: Annotated[float, Field(gt=0, le=3600)] = 40.0
    """Time once round the path, simulated seconds."""
    semi_axes: tuple[SemiAxis, SemiAxis] = (1.6, 1.2)
    """Half lengths of the path along x and y, metres."""
    deformation: str = "breathing"
    """rigid, or kind[:amplitude[:hz[:phase]]] joined by +; kinds breathing, squash, bend, twist,
    wave."""

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """How many cameras, each its own process."""
    resolution: str = "640x480"
    """Image size, WIDTHxHEIGHT in pixels."""
    vfov: Annotated[float, Field(gt=1, lt=170)] = 45.0
    """Vertical field of view of the cameras, degrees."""
    noise: Literal["ideal", "nguyen", "d4xx"] = "nguyen"
    """Depth noise model of the cameras."""

    drive: Literal["flying", "unicycle"] = "flying"
    """flying: cameras take any view; unicycle: each is fixed on a robot with wheels."""
    controller: Literal[
        "kanayama", "samson", "morin_samson", "dynamic_feedback", "input_output"
    ] = "kanayama"
    """With drive unicycle: what keeps the robots on their references."""
    actuator_lag: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Time constant with which a camera's velocity follows its command, seconds."""
    actuator_noise: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Standard deviation of slip or gusts at each instant, metres per second."""
    actuator_turn_noise: Annotated[float, Field(ge=0, le=10)] = 0.0
    """The same of the turn rate, radians per second."""

    radius: Annotated[float, Field(gt=0, le=100)] = 1.1
    """Distance of the cameras from the object's centre, metres."""
    elevation: Annotated[float, Field(ge=-85, le=85)] = 20.0
    """Of the cameras above the horizontal, degrees; of the lowest, if they differ."""
    top_elevation: Annotated[float, Field(ge=-85, le=85)] = 60.0
    """Of the highest cameras of rings, sphere and random, degrees."""
    rings: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 2
    """How many rings share the cameras."""
    orbit: Annotated[float, Field(ge=-180, le=180)] = 10.0
    """How fast the orbit turns about the object, degrees per second."""
    redraw: Annotated[float, Field(gt=0, le=3600)] = 5.0
    """From one draw of random views to the next, seconds."""
    change_speed: Annotated[float, Field(gt=0, le=100)] = 1.5
    """How fast cameras fly to other places when the formation changes, metres per second."""
    safe_distance: Annotated[float, Field(ge=0, le=10)] = 0.2
    """What cameras keep from each other then, metres."""
    view_file: Path | None = None
    """Views for `static` and `dome`: lines `x y z qx qy qz qw`."""
    dwell: Annotated[float, Field(ge=0, le=3600)] = 0.2
    """Rest at each view of the dome, seconds."""
    travel: Annotated[float, Field(gt=0, le=3600)] = 1.0
    """Flight from one view of the dome to the next, seconds."""
    infeasible: Literal["refuse", "allow"] = "refuse"
    """A formation that loses sight of the object or asks too much of its robots: refuse, or allow,
    to see it fail."""

    voxel_size: Annotated[float, Field(gt=0, le=1)] = 0.01
    """Edge of a voxel, metres."""
    memory: Literal["persistent", "instant", "decay"] = "instant"
    """What the map keeps: all, this instant only, or with a half-life."""
    half_life: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """With memory decay: time after which half of what is known is gone, simulated seconds."""
    frames_to_clear: Annotated[int, Field(ge=1, le=1000)] | None = None
    """What has gone is free after so many frames that see through it; OctoMap's 9 if not given."""
    frames_to_appear: Annotated[int, Field(ge=1, le=1000)] | None = None
    """What has come is occupied after so many frames that see it; OctoMap's 3 if not given."""
    frame: Literal["target", "world"] = "target"
    """Frame of the map."""
    follow: Literal["none", "target"] = "none"
    """With frame world: the map's box moves with the object, by whole bricks."""
    archive: bool = False
    """Keep what leaves a following box, and have it again when the box is back."""

    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of all noise."""
    mode: Literal["lockstep", "realtime"] = "lockstep"
    """lockstep: every instant is waited for; realtime: paced by the clock."""
    rate: Annotated[float, Field(gt=0, le=1000)] = 15.0
    """Instants per simulated second."""
    duration: Annotated[float, Field(gt=0)] | None = None
    """Simulated seconds; one lap if not given."""
    forever: bool = False
    """Go on until Ctrl-C."""

    evaluator: bool = True
    """Score every instant against the truth."""
    viewer: bool = True
    """Show the run in a browser."""
    viewer_port: Annotated[int, Field(ge=1, le=65535)] = 8080
    """Where its page is served on this machine; the next free port when it is taken."""
    headless: bool = False
    """Print a line now and then instead of the live table."""
    save_map: Path | None = None
    """Also write the last map here (.npz .ply .bt .ot .obj .glb; see `encircle convert`)."""
    record: Path | None = None
    """Record all that is said into this file (.mcap); recording.mcap in the run's folder if no
    name is given."""
    report: Path | None = None
    """Also write the report here (JSON)."""
    runs: Path = Path("runs")
    """Folder that receives a folder per run."""
    port: Annotated[int, Field(ge=1, le=65535)] | None = None
    """Loopback port of the router; 7447, or a free one, if not given."""

    @field_validator("resolution")
    @classmethod
    def _resolution_is_width_x_height(cls, text: str) -> str:
        match = _RESOLUTION.fullmatch(text)
        if not match or not all(16 <= int(side) <= MAX_SIDE_PX for side in match.groups()):
            raise ValueError(f"must be WIDTHxHEIGHT, sides 16..{MAX_SIDE_PX}, e.g. 640x480")
        return text

    @field_validator("record")
    @classmethod
    def _recording_is_mcap(cls, path: Path | None) -> Path | None:
        if path is not None and path != RUNS_OWN and path.suffix != ".mcap":
            raise ValueError("must end with .mcap")
        return path

    @field_validator("save_map")
    @classmethod
    def _map_format_is_known(cls, path: Path | None) -> Path | None:
        if path is not None and path.suffix not in MAP_SUFFIXES:
            raise ValueError(f"must end with one of {' '.join(MAP_SUFFIXES)}")
        return path

    @model_validator(mode="after")
    def _an_end_or_none(self) -> Self:
        self._the_box_holds_the_object()
        for name in ("frames_to_clear", "frames_to_appear"):
            if getattr(self, name) is not None and self.memory == "instant":
                raise ValueError(
                    f"{name} {getattr(self, name)} with memory instant: nothing is kept from frame "
                    "to frame; choose memory persistent or decay"
                )
        if self.drive == "unicycle" and self.strategy in ("orbit", "random", "dome"):
            raise ValueError(
                f"drive unicycle with strategy {self.strategy}: its cameras must fly; choose "
                "strategy circle, adaptive_scale, constant_angles, adaptive_angles, rings, "
                "sphere or static, or drive flying"
            )
        if self.forever and self.duration is not None:
            raise ValueError("forever and duration exclude each other")
        return self

    def _the_box_holds_the_object(self) -> None:
        if self.target == "map" and (self.frame, self.follow) != ("world", "none"):
            raise ValueError(
                f"target map with frame {self.frame} and follow {self.follow}: the map's box would "
                "go with the pose that nobody is to know; choose frame world and follow none"
            )
        if self.target == "map":
            lasting_s = None if self.forever else self.duration or self.lap
            refuse_what_leaves(self.arena, self.path, self.semi_axes, self.lap, lasting_s)
        stays = self.frame == "world" and self.follow == "none" and self.target != "map"
        if stays and self.path != "static":
            raise ValueError(
                f"frame world with path {self.path}: the map's box stands around the origin and "
                "the object would leave it; choose path static or frame target, or follow target"
            )
        if self.frame == "target" and self.follow == "target":
            raise ValueError(
                "follow target with frame target: there the object stands still; choose frame "
                "world, or follow none"
            )
        if self.archive and (self.follow == "none" or self.memory == "instant"):
            raise ValueError(
                f"archive with follow {self.follow} and memory {self.memory}: it needs follow "
                "target and memory persistent or decay"
            )

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        width, height = self.resolution.split("x")
        return int(width), int(height)

    @property
    def map_box(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Corners of the map's box: around an object of this height, or the arena; map frame, m."""
        reach, top = 1.5 * self.height, 1.75 * self.height
        if self.target == "map":
            low_x, low_y, high_x, high_y = self.arena
            return (low_x, low_y, -0.1), (high_x, high_y, top)
        return (-reach, -reach, -0.1), (reach, reach, top)

    @property
    def dt_s(self) -> float:
        """Simulated time between two instants."""
        return 1.0 / self.rate

    @property
    def num_ticks(self) -> int | None:
        """Instants of the run; None: without end."""
        if self.forever:
            return None
        return max(1, round((self.duration or self.lap) * self.rate))
