"""The scene is the same wherever its spec is known."""

import numpy as np
import pytest

from schemas.sim import SceneSpec
from services.kernels.deform import deform
from services.kernels.rigid import apply, planar
from services.world.deformation import parse_deformations
from services.world.errors import WorldError
from services.world.scene import Scene
from services.world.warm_up import warm_up

pytestmark = pytest.mark.unit


def spec(**changes):
    fields = {"object": "sphere", "height_m": 0.4, "subdivide": 1, "seed": 1}
    fields["deformations"] = parse_deformations("squash+bend")
    return SceneSpec(**(fields | changes))


def test_two_processes_that_know_the_spec_see_the_same_surface():
    a = Scene.from_spec(spec())
    b = Scene.from_spec(SceneSpec.model_validate_json(spec().model_dump_json()))
    np.testing.assert_array_equal(a.faces, b.faces)
    for t in (0.0, 1.3, 1e4):
        np.testing.assert_array_equal(a.mesh_at(t), b.mesh_at(t))


def test_the_surface_in_the_world_is_the_surface_moved_by_the_target_s_pose():
    scene, T = Scene.from_spec(spec()), planar(1.0, -2.0, 0.7)
    moved = scene.vertices_world(1.3, T)
    assert moved.dtype == np.float32
    np.testing.assert_allclose(moved, apply(T, scene.mesh_at(1.3)), atol=1e-6)


def test_scenes_share_the_rest_pose_and_cannot_spoil_it():
    a, b = Scene.from_spec(spec()), Scene.from_spec(spec(deformations=()))
    assert a.rest is b.rest
    with pytest.raises(ValueError, match="read-only"):
        b.mesh_at(0.0)[0, 0] = 1.0


def test_a_spec_that_cannot_be_built_is_a_world_error():
    with pytest.raises(WorldError, match="rabbit"):
        Scene.from_spec(spec(object="rabbit"))
    inside_out = [{"kind": "squash", "amplitude": 1.9, "hz": 1.0}]
    with pytest.raises(WorldError, match="squash"):
        Scene.from_spec(spec(deformations=inside_out))


def test_warming_up_compiles_all_that_a_deforming_scene_runs():
    warm_up()
    compiled = len(deform.signatures)
    Scene.from_spec(spec(object="bunny", subdivide=2)).mesh_at(1.0)
    assert len(deform.signatures) == compiled > 0
