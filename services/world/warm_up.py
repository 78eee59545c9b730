"""Compile the deformation's kernel ahead, with the very types that scenes use."""

from schemas.sim import SceneSpec
from services.world.deformation import parse_deformations
from services.world.scene import Scene


def warm_up() -> None:
    """Deform a small body once; numba caches the kernel for all processes to come."""
    deformations = parse_deformations("breathing")
    spec = SceneSpec(object="box", height_m=0.4, subdivide=0, deformations=deformations, seed=0)
    Scene.from_spec(spec).mesh_at(0.0)
