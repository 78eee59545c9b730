"""Built-in shapes and mesh files come out as solids that stand on the ground."""

import numpy as np
import pytest
import trimesh

from services.world.errors import MeshError
from services.world.mesh import load_mesh
from services.world.shapes import NAMES
from services.world.subdivision import loop, split
from services.world.winding import outward

pytestmark = pytest.mark.unit

TETRAHEDRON_OFF = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 2\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"


def solid(mesh):
    return trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)


def assert_stands(mesh, height_m):
    assert mesh.vertices_m.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    np.testing.assert_allclose(low[:2], -high[:2], atol=1e-6 * height_m)
    assert low[2] == 0.0
    assert high[2] == pytest.approx(height_m, rel=1e-6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("height_m", [0.4, 3.0])
def test_a_built_in_shape_is_a_closed_solid_that_stands_on_the_ground(name, height_m):
    mesh = load_mesh(name, height_m)
    assert_stands(mesh, height_m)
    assert solid(mesh).is_volume  # closed, consistent, outward.
    assert solid(mesh).volume > 0


def test_the_bunny_has_the_promised_triangles_and_its_head_is_in_front():
    assert len(load_mesh("bunny", subdivide=0).faces) == 902
    mesh = load_mesh("bunny")
    assert len(mesh.faces) == 14432
    ears = mesh.vertices_m[mesh.vertices_m[:, 2] > 0.36]
    assert ears[:, 0].min() > 0.0


def test_volumes_are_those_of_the_shapes():
    assert solid(load_mesh("box", 0.4)).volume == pytest.approx(0.4**3, rel=1e-5)
    assert solid(load_mesh("sphere", 0.4)).volume == pytest.approx(np.pi / 6 * 0.4**3, rel=5e-3)
    torus = 2 * np.pi**2 * 0.14 * 0.06**2
    assert solid(load_mesh("torus", 0.4)).volume == pytest.approx(torus, rel=1e-2)


def test_splitting_keeps_the_surface_and_loop_stays_inside_the_hull():
    mesh = load_mesh("bunny", subdivide=0)
    coarse = (mesh.vertices_m.astype(np.float64), mesh.faces.astype(np.int64))
    fine = trimesh.Trimesh(*split(*coarse), process=False)
    assert fine.is_volume
    assert fine.volume == pytest.approx(solid(mesh).volume, rel=1e-9)
    assert fine.area == pytest.approx(solid(mesh).area, rel=1e-9)
    smooth = trimesh.Trimesh(*loop(*coarse), process=False)
    assert (smooth.bounds[0] >= solid(mesh).bounds[0]).all()
    assert (smooth.bounds[1] <= solid(mesh).bounds[1]).all()


def test_loop_agrees_with_trimesh():
    mesh = solid(load_mesh("bunny", subdivide=0))
    ours, _ = loop(mesh.vertices.view(np.ndarray), mesh.faces.astype(np.int64))
    theirs = mesh.subdivide_loop(1).vertices
    np.testing.assert_allclose(ours[np.lexsort(ours.T)], theirs[np.lexsort(theirs.T)], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_triangles_turned_at_random_are_all_turned_outward_again(seed):
    rng = np.random.default_rng(seed)
    parts = [load_mesh(name, subdivide=0) for name in ("torus", "bunny")]
    vertices = np.concatenate([m.vertices_m + [i, 0, 0] for i, m in enumerate(parts)])
    faces = np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices_m)])
    faces = faces.astype(np.int64)
    spoiled = np.where(rng.random((len(faces), 1)) < 0.3, faces[:, ::-1], faces)
    fixed = trimesh.Trimesh(vertices, outward(vertices, spoiled), process=False)
    right = trimesh.Trimesh(vertices, faces, process=False)
    np.testing.assert_allclose(fixed.face_normals, right.face_normals, atol=1e-9)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".off"])
def test_every_kind_of_file_gives_the_same_solid(tmp_path, suffix):
    original = load_mesh("torus", 1.0)
    path = tmp_path / f"ring{suffix}"
    solid(original).export(path)
    mesh = load_mesh(f"{path}:z", 0.5)
    assert_stands(mesh, 0.5)
    assert solid(mesh).is_volume
    assert len(mesh.vertices_m) == len(original.vertices_m)  # STL's repeated corners are merged.
    assert solid(mesh).volume == pytest.approx(solid(original).volume / 8, rel=1e-4)


@pytest.mark.parametrize(("axis", "forward"), [("x", "y"), ("y", "z"), ("z", "x")])
def test_the_named_axis_comes_out_up_and_the_next_one_forward(tmp_path, axis, forward):
    size = {"x": 1.0, "y": 1.0, "z": 1.0} | {axis: 4.0, forward: 2.0}
    path = tmp_path / "brick.off"
    trimesh.creation.box(extents=[size[a] for a in "xyz"]).export(path)
    mesh = load_mesh(f"{path}:{axis}", 4.0)
    np.testing.assert_allclose(np.ptp(mesh.vertices_m, axis=0), [2, 1, 4], atol=1e-5)
    assert solid(mesh).is_volume
    assert solid(mesh).volume == pytest.approx(8.0, rel=1e-5)


def test_a_scan_is_y_up_and_a_part_is_z_up_unless_said_otherwise(tmp_path):
    ring = solid(load_mesh("torus", 1.0))  # thin along y.
    for suffix, extents in [(".obj", [1 / 0.3, 1 / 0.3, 1]), (".stl", [1, 0.3, 1])]:
        path = tmp_path / f"ring{suffix}"
        ring.export(path)
        np.testing.assert_allclose(
            np.ptp(load_mesh(str(path), 1.0).vertices_m, axis=0), extents, rtol=1e-3
        )


def test_an_unknown_object_names_the_choices():
    with pytest.raises(MeshError, match=r"'rabbit'; known: bunny, sphere, box, torus.*\.ply"):
        load_mesh("rabbit")
    with pytest.raises(MeshError, match=r"no file.*built in: bunny"):
        load_mesh("/nowhere/rabbit.ply")


@pytest.mark.parametrize(
    ("name", "content", "rule"),
    [
        ("a.ply", "", "empty"),
        ("a.obj", "# nothing\n", "no triangles|not a readable"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex 9\n", "not a readable"),
        ("a.stl", "\x00\x01 garbage", "not a readable|no triangles"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 nan\n3 0 1 2\n", "not finite"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "outside|not a readable"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "at least 4"),
        ("a.off", TETRAHEDRON_OFF.replace("0 0 2", "1 1 0"), "no height"),
        (
            "a.off",
            TETRAHEDRON_OFF.replace("0 0 2", "2 0 0").replace("0 1 0", "3 0 0"),
            "at least 4",
        ),
    ],
)
def test_a_bad_file_is_refused_with_the_reason(tmp_path, name, content, rule):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(MeshError, match=rule):
        load_mesh(str(path))


def test_a_file_beyond_the_limit_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "huge.ply"
    with path.open("wb") as file:
        file.truncate(1 << 30)  # sparse.
    with pytest.raises(MeshError, match="bytes, at most"):
        load_mesh(str(path))


@pytest.mark.parametrize("seed", range(30))
def test_no_garbage_escapes_as_another_error(tmp_path, seed):
    rng = np.random.default_rng(seed)
    suffix = (".obj", ".ply", ".stl", ".off")[seed % 4]
    path = tmp_path / f"ring{suffix}"
    solid(load_mesh("torus", 1.0)).export(path)
    data = bytearray(path.read_bytes())
    for at in rng.integers(0, min(len(data), 2000), 20):
        data[at] = rng.integers(256)
    path.write_bytes(data[: rng.integers(1, len(data))])
    try:
        mesh = load_mesh(str(path))
    except MeshError:
        return
    assert np.isfinite(mesh.vertices_m).all()
    assert_stands(mesh, 0.4)


@pytest.mark.parametrize("height_m", [0.0, -1.0, np.nan, np.inf])
def test_a_height_that_is_none_is_refused(height_m):
    with pytest.raises(MeshError, match="height_m"):
        load_mesh("box", height_m)
    with pytest.raises(MeshError, match="subdivide"):
        load_mesh("box", subdivide=9)
