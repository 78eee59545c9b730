"""The target's true surface at any time."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.sim import SceneSpec
from services.kernels.rigid import FloatArray
from services.world.deformation import check, deformed
from services.world.mesh import Mesh, load_mesh


@dataclass(frozen=True)
class Scene:
    """A body and how it deforms; the same everywhere the same spec is known."""

    spec: SceneSpec
    rest: Mesh
    """The undeformed mesh, target frame."""

    @classmethod
    def from_spec(cls, spec: SceneSpec) -> "Scene":
        """Build the scene; the last few rest meshes are kept.

        Raises:
            WorldError: If the object or a deformation is not usable.
        """
        check(spec.deformations)
        return cls(spec, _rest(spec.object, spec.height_m, spec.subdivide))

    @property
    def faces(self) -> NDArray[np.int32]:
        """(F, 3) triangles, the same at all times."""
        return self.rest.faces

    def mesh_at(self, t_s: float) -> NDArray[np.float32]:
        """Return the (V, 3) vertices in the target frame at simulated time `t_s`; read only."""
        return deformed(self.rest.vertices_m, self.spec.height_m, self.spec.deformations, t_s)

    def vertices_world(self, t_s: float, T_world_target: FloatArray) -> NDArray[np.float32]:
        """Return the (V, 3) vertices in `world` at simulated time `t_s`."""
        moved = self.mesh_at(t_s) @ T_world_target[:3, :3].T + T_world_target[:3, 3]
        return moved.astype(np.float32)


def scene_of(params: Mapping[str, Any]) -> SceneSpec:
    """Return the scene that a request `prepare` {scene} names.

    Raises:
        ValidationError: If it is none.
    """
    return SceneSpec.model_validate(params.get("scene"))


@lru_cache(maxsize=4)
def _rest(name: str, height_m: float, subdivide: int) -> Mesh:
    mesh = load_mesh(name, height_m, subdivide)
    mesh.vertices_m.setflags(write=False)
    mesh.faces.setflags(write=False)
    return mesh
