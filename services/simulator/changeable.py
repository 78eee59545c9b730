"""What may change while the simulated world runs."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from schemas.camera import MAX_CAMERAS
from schemas.sim import SceneSpec
from services.runtime.command import only
from services.world.deformation import parse_deformations
from services.world.shapes import NAMES


class Changeable(BaseModel):
    """Flat, so that environment, flags and `ctl/simulator/set` name each by one word."""

    model_config = ConfigDict(frozen=True)

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
    cameras: Annotated[int, Field(ge=1, le=MAX_CAMERAS)] = 6
    """Number of cameras in the world; tick 0 waits for all of them."""

    def scene(self, seed: int) -> SceneSpec:
        """Return what all processes need to build the same object.

        Raises:
            DeformationError: If the deformation is unknown or out of its limits.
        """
        # Other processes may run in another folder.
        known = self.object in NAMES or not Path(self.object).is_file()
        name = self.object if known else str(Path(self.object).resolve())
        return SceneSpec(
            object=name if self.up == "auto" else f"{name}:{self.up}",
            height_m=self.height_m,
            subdivide=self.subdivide,
            deformations=parse_deformations(self.deformation),
            seed=seed,
        )

    def changed(self, params: dict[str, Any]) -> "Changeable":
        """Return the same with some replaced.

        Raises:
            BadCommand: If a name is not one of ours.
            ValidationError: If a value breaks its rule.
        """
        only(params, *Changeable.model_fields)
        current = {name: getattr(self, name) for name in Changeable.model_fields}
        return Changeable.model_validate(current | params)
