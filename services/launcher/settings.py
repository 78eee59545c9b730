"""What `encircle run` can be told; default < scenario < environment < flag."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from schemas.camera import MAX_CAMERAS, MAX_SIDE_PX

ENV_PREFIX = "ENCIRCLE_RUN_"
_RESOLUTION = re.compile(r"(\d{1,5})x(\d{1,5})")


class RunSettings(BaseModel):
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
    deformation: str = "breathing"
    """rigid, or kind[:amplitude[:hz[:phase]]] joined by +; kinds breathing, squash, bend, twist,
    wave."""

    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """How many cameras, each its own process."""
    resolution: str = "640x480"
    """Image size, WIDTHxHEIGHT in pixels."""
    noise: Literal["ideal", "nguyen", "d4xx"] = "nguyen"
    """Depth noise model of the cameras."""

    strategy: Literal["circle", "static", "dome"] = "circle"
    """circle: a ring around the moving target; static: a ring at rest; dome: view after view."""
    radius: Annotated[float, Field(gt=0, le=100)] = 1.1
    """Distance of the cameras from the object's centre, metres."""
    elevation: Annotated[float, Field(ge=-85, le=85)] = 20.0
    """Of the cameras above the horizontal, degrees."""
    view_file: Path | None = None
    """Views for `static` and `dome`: lines `x y z qx qy qz qw`."""
    dwell: Annotated[float, Field(ge=0, le=3600)] = 0.2
    """Rest at each view of the dome, seconds."""
    travel: Annotated[float, Field(gt=0, le=3600)] = 1.0
    """Flight from one view of the dome to the next, seconds."""

    voxel_size: Annotated[float, Field(gt=0, le=1)] = 0.01
    """Edge of a voxel, metres."""
    memory: Literal["persistent", "instant", "decay"] = "instant"
    """What the map keeps: all, this instant only, or with a half-life."""
    frame: Literal["target", "world"] = "target"
    """Frame of the map."""

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
    headless: bool = False
    """Print a line now and then instead of the live table."""
    save_map: Path | None = None
    """Also write the last map here (.ply or .npz)."""
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

    @field_validator("save_map")
    @classmethod
    def _map_format_is_known(cls, path: Path | None) -> Path | None:
        if path is not None and path.suffix not in (".ply", ".npz"):
            raise ValueError("must end with .ply or .npz")
        return path

    @model_validator(mode="after")
    def _an_end_or_none(self) -> Self:
        if self.frame == "world" and self.path != "static":
            raise ValueError(
                f"frame world with path {self.path}: the map's box stands around the origin and "
                "the object would leave it; choose path static or frame target"
            )
        if self.forever and self.duration is not None:
            raise ValueError("forever and duration exclude each other")
        return self

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        width, height = self.resolution.split("x")
        return int(width), int(height)

    @property
    def map_box(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Corners of the map's box around an object of this height, map frame, metres."""
        reach, top = 1.5 * self.height, 1.75 * self.height
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
