"""Maps on disk: names tell formats, files are whole or not there, a bad one is an error."""

import io
import os
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pyoctomap import ColorOcTree

from services.mapper import formats, safe_file
from services.mapper.box import Box
from services.mapper.errors import BadMapFile, MapperError, MapTooLarge
from services.mapper.npz_file import npz_bytes, read_npz
from services.mapper.octree_file import ot_bytes
from services.mapper.ply_file import ply_bytes, read_ply
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.stored_map import StoredMap
from services.mapper.voxel_map import VoxelMap
from tests.octree_reference import random_map, voxels_of

pytestmark = pytest.mark.unit

BOX = Box(0.05, (-13, 5, -3), (3, 3, 2))


@pytest.fixture(params=[False, True], ids=["plain", "colored"])
def stored(request) -> StoredMap:
    return random_map(np.random.default_rng(3), BOX, request.param)


def occupied(stored: StoredMap) -> dict:
    return {key: voxel for key, voxel in voxels_of(stored).items() if voxel[0] >= 0}


def test_an_npz_holds_everything(stored: StoredMap) -> None:
    back = read_npz(npz_bytes(stored))
    assert (back.box, back.sensor) == (stored.box, stored.sensor)
    assert voxels_of(back) == voxels_of(stored)
    assert (back.color is None) == (stored.color is None)


def test_a_ply_holds_the_occupied_voxels_and_their_size(stored: StoredMap) -> None:
    back = read_ply(ply_bytes(stored))
    assert back.box.resolution_m == BOX.resolution_m
    expected, found = occupied(stored), occupied(back)
    assert found.keys() == expected.keys()
    assert len(voxels_of(back)) == len(found)
    for key, (log_odds, color) in expected.items():
        assert abs(found[key][0] - log_odds) <= 2  # single precision of a probability near 1.
        assert found[key][1] == color


@pytest.mark.parametrize("suffix", [".npz", ".ply", ".bt", ".ot"])
def test_every_format_that_is_read_is_written(suffix: str, stored: StoredMap, tmp_path) -> None:
    path = tmp_path / f"map{suffix}"
    formats.write(stored, path)
    assert occupied(formats.read(path)).keys() == occupied(stored).keys()
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("suffix", [".npz", ".ot"])
def test_a_map_is_saved_and_loaded_whole(suffix: str, tmp_path) -> None:
    voxels = VoxelMap(0.02, (-0.3, -0.3, -0.1), (0.3, 0.3, 0.3))
    rng = np.random.default_rng(4)
    voxels.fuse_points(rng.uniform(-0.25, 0.25, (300, 3)), (0.0, 0.0, 0.1))
    voxels.save(tmp_path / f"map{suffix}")
    loaded = VoxelMap.load(tmp_path / f"map{suffix}")
    assert voxels_of(loaded.stored()) == voxels_of(voxels.stored())


def painted() -> VoxelMap:
    """A wall, left half red and right half blue, that a camera at the origin sees."""
    voxels = VoxelMap(0.02, (-0.4, -0.4, 0.2), (0.4, 0.4, 1.2))
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[:, :32, 0] = picture[:, 32:, 2] = 200
    depth = np.full((48, 64), 1010, np.uint16)
    voxels.fuse_depth(depth, (100.0, 100.0, 31.5, 23.5), np.eye(4), color=picture)
    return voxels


def test_colors_reach_octomap_points_and_surfaces(tmp_path) -> None:
    voxels = painted()
    for suffix in (".ot", ".ply", ".glb"):
        voxels.save(tmp_path / f"map{suffix}")
    tree = ColorOcTree(1.0).read(str(tmp_path / "map.ot"))
    points = formats.read(tmp_path / "map.ply")
    assert occupied(points).keys() == occupied(voxels.stored()).keys()
    for key, (_, color) in occupied(points).items():
        centre = (np.array(key) - 32768 + 0.5) * 0.02
        assert tuple(tree.search(centre).getColor()) == color
        if abs(centre[0]) > 0.02:
            assert color == ((200, 0, 0) if centre[0] < 0 else (0, 0, 200))
    mesh = trimesh.load(tmp_path / "map.glb", force="mesh", process=False)
    left, right = mesh.vertices[:, 0] < -0.06, mesh.vertices[:, 0] > 0.06
    assert (mesh.visual.vertex_colors[left, :3] == (200, 0, 0)).all()
    assert (mesh.visual.vertex_colors[right, :3] == (0, 0, 200)).all()


def test_what_has_gone_leaves_no_color_and_free_space_is_pruned() -> None:
    voxels = painted()
    nothing = np.full((48, 64), 65535, np.uint16)
    for _ in range(3):
        voxels.fuse_depth(nothing, (100.0, 100.0, 31.5, 23.5), np.eye(4), max_range_m=3.0)
    stored = voxels.stored()
    assert voxels.counts().occupied == 0
    assert (stored.color == 255).all()
    assert num_nodes(ot_bytes(stored)) == num_nodes(ot_bytes(replace(stored, color=None)))


def num_nodes(data: bytes) -> int:
    return int(data.split(b"\nsize ", 1)[1].split(b"\n", 1)[0])


def test_a_map_with_an_archive_is_saved_with_it(tmp_path) -> None:
    voxels = VoxelMap(0.05, (-1, -1, -1), (1, 1, 1), archive=True)
    everywhere = []
    for x in (0.0, 3.0, -2.0):
        voxels.move_to((x, 0.0, 0.0))
        voxels.fuse_points([(x + 0.5, 0.0, 0.0)], (x, 0.0, 0.0))
        everywhere.append((x + 0.5, 0.0, 0.0))
    voxels.save(tmp_path / "map.npz")
    loaded = VoxelMap.load(tmp_path / "map.npz")
    assert loaded.classify(everywhere).tolist() == [2, 2, 2]
    assert loaded.counts().occupied == len(voxels.occupied().centres_m) == 3


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("map.xyz", r"'\.xyz' of .*map\.xyz; known: \.npz, \.ply, \.bt, \.ot"),
        ("map", r"'' of"),
        ("map.NPZ", r"'\.NPZ'"),
    ],
)
def test_an_unknown_name_is_answered_with_the_known_ones(name: str, says: str, tmp_path) -> None:
    stored = random_map(np.random.default_rng(3), BOX, False)
    with pytest.raises(BadMapFile, match=says):
        formats.write(stored, tmp_path / name)
    with pytest.raises(BadMapFile, match=says):
        formats.read(tmp_path / name)
    assert not os.listdir(tmp_path)


def test_a_surface_is_no_map_to_read(tmp_path) -> None:
    with pytest.raises(BadMapFile, match="is a surface, not a map"):
        formats.read(tmp_path / "map.glb")


@pytest.mark.parametrize("name", ["none/map.npz", "folder.npz", "f" * 300 + ".npz"])
def test_what_cannot_be_written_or_read_is_an_error_with_the_name(name: str, tmp_path) -> None:
    (tmp_path / "folder.npz").mkdir()
    stored = random_map(np.random.default_rng(3), BOX, False)
    with pytest.raises(BadMapFile, match=r"cannot write .*\.npz: "):
        formats.write(stored, tmp_path / name)
    with pytest.raises(BadMapFile, match=r"cannot read .*\.npz: "):
        formats.read(tmp_path / name)
    assert os.listdir(tmp_path) == ["folder.npz"]


def test_a_file_that_cannot_be_replaced_stays_as_it_was(tmp_path, monkeypatch) -> None:
    path = tmp_path / "map.npz"
    path.write_bytes(b"before")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        safe_file.replace(path, b"after")
    assert path.read_bytes() == b"before"
    assert os.listdir(tmp_path) == ["map.npz"]


def test_a_map_that_a_format_cannot_hold_leaves_the_old_file(tmp_path) -> None:
    stored = random_map(np.random.default_rng(3), Box(0.05, (40000, 0, 0), (3, 3, 2)), False)
    (tmp_path / "map.bt").write_bytes(b"before")
    with pytest.raises(MapTooLarge, match=r"cannot write .*map\.bt: .*OctoMap's 32768 voxels"):
        formats.write(stored, tmp_path / "map.bt")
    assert (tmp_path / "map.bt").read_bytes() == b"before"


# .npz: what is in it.


def archive(**changed: object) -> bytes:
    """Our archive with some arrays replaced, or, given None, left out."""
    good = np.load(io.BytesIO(npz_bytes(random_map(np.random.default_rng(3), BOX, False))))
    arrays = {name: good[name] for name in good.files} | changed
    file = io.BytesIO()
    np.savez(file, **{name: np.asarray(a) for name, a in arrays.items() if a is not None})
    return file.getvalue()


ONES = np.zeros((1, 512), np.int16)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"format": "encircle-map-9"}, "format is 'encircle-map-9'.*reads 'encircle-map-1'"),
        ({"bricks": None}, "bricks.npy"),
        ({"resolution_m": np.nan}, "voxel size nan"),
        ({"resolution_m": [0.1, 0.2]}, "no map of ours"),
        ({"num_bricks": [3, 3]}, r"a box of \[3, 3\] bricks"),
        ({"num_bricks": [3, 0, 2]}, r"a box of \[3, 0, 2\] bricks"),
        ({"num_bricks": [4000, 4000, 4000]}, "GiB"),
        ({"num_bricks": [2**62, 1, 1]}, "GiB"),
        ({"first_key": [2**40, 0, 0]}, "must lie within"),
        ({"sensor": [0.4, 0.7, 0.1, 0.9]}, "they must satisfy"),
        ({"sensor": [0.7]}, "4 numbers"),
        ({"bricks": [[9, 0, 0]], "log_odds": ONES}, "bricks is int64"),
        ({"bricks": np.int16([[9, 0, 0]]), "log_odds": ONES}, r"brick \[9, 0, 0\] does not lie"),
        ({"bricks": np.int16([[-1, 0, 0]]), "log_odds": ONES}, r"brick \[-1, 0, 0\] does not"),
        ({"bricks": np.int16([[1, 0, 0]] * 2), "log_odds": np.repeat(ONES, 2, 0)}, "there twice"),
        ({"log_odds": ONES}, r"log_odds is int16 \(1, 512\); it must be int16"),
        ({"log_odds": np.zeros((2, 511), np.int16)}, "log_odds is int16"),
        ({"bricks": np.int16(3)}, "no map of ours|bricks is"),
        ({"color": np.zeros((1, 512, 3), np.uint8)}, "color is uint8"),
        ({"bricks": np.array([{}], object)}, "no map of ours"),
    ],
)
def test_an_archive_with_bad_content_is_refused(changed: dict, says: str) -> None:
    with pytest.raises(MapperError, match=says):
        read_npz(archive(**changed))


def test_an_archive_that_unfolds_beyond_its_box_is_refused_before_it_does() -> None:
    file = io.BytesIO(archive(log_odds=None))
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as bomb:
        bomb.writestr("log_odds.npy", bytes(50_000_000))
    with pytest.raises(BadMapFile, match="log_odds has 50000000 bytes; its box allows 18432"):
        read_npz(file.getvalue())


# .ply: anybody's points.


def ply(kind: str, rows: str, *properties: str, size: str = "") -> bytes:
    lines = ["ply", f"format {kind} 1.0", *([f"comment {size}"] if size else [])]
    lines += [f"element vertex {len(rows.splitlines())}", *(f"property {p}" for p in properties)]
    return "\n".join(
        [*lines, "element face 0", "property list uchar int vertex_indices"]
    ).encode() + (b"\nend_header\n" + rows.encode())


XYZ = ("float x", "float y", "float z")


def test_points_of_others_are_read_at_the_size_that_is_asked_for() -> None:
    points = "0.25 0.25 0.25\n0.26 0.25 0.25\n-1 0 0.5\nnan 0 0\n"
    stored = read_ply(ply("ascii", points, *XYZ), 0.1)
    hit = SensorModel().fixed_point()[0]
    found = {key: log_odds for key, (log_odds, _) in voxels_of(stored).items()}
    assert found == {(32770, 32770, 32770): hit, (32758, 32768, 32773): hit}


@pytest.mark.parametrize("kind", ["binary_big_endian", "binary_little_endian"])
def test_binary_points_of_both_orders_are_read(kind: str) -> None:
    order = ">" if "big" in kind else "<"
    fields = [("nx", "i2"), ("x", "f8"), ("y", "f4"), ("z", "f4"), ("red", "u1"), ("green", "u1")]
    fields = [(name, order + code) for name, code in [*fields, ("blue", "u1")]]
    rows = np.array([(7, 0.25, 0.35, 0.45, 1, 2, 3), (7, 1.25, 0.35, 0.45, 4, 5, 6)], fields)
    names = ("short nx", "double x", "float32 y", "float z", "uchar red", "uint8 green")
    head = ply(kind, "a\nb", *names, "uchar blue").split(b"end_header\n")[0]
    stored = read_ply(head + b"end_header\n" + rows.tobytes(), 0.1)
    colors = {key: color for key, (_, color) in voxels_of(stored).items()}
    assert colors == {(32770, 32771, 32772): (1, 2, 3), (32780, 32771, 32772): (4, 5, 6)}


def test_of_points_in_one_voxel_the_most_probable_one_counts() -> None:
    rows = "0 0 0 0.6\n0 0 0 0.9\n0 0 0 0.7\n"
    (voxel,) = voxels_of(read_ply(ply("ascii", rows, *XYZ, "float probability"), 0.1)).values()
    assert voxel[0] == round(np.log(9) * LOG_ODDS_SCALE)


def test_a_file_of_no_points_is_an_empty_map() -> None:
    assert len(read_ply(ply("ascii", "", *XYZ), 0.1).bricks) == 0


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "begins b''"),
        (b"solid x\n", "a PLY begins 'ply'"),
        (b"ply\nformat ascii 1.0\n", "tells 'end_header'"),
        (ply("ascii", "0 0 0", "float x", "float y"), "with x, y, z"),
        (ply("ascii", "0 0 0", *XYZ, "float x"), "with x, y, z"),
        (ply("utf8", "0 0 0", *XYZ), "format 'utf8'"),
        (ply("ascii", "0 0 0", *XYZ, "list uchar int i"), "a vertex has 'list uchar int i'"),
        (ply("ascii", "0 0 0", *XYZ, "quad q"), "a vertex has 'quad q'"),
        (ply("ascii", "0 0", *XYZ), "0 vertices; the header says 1"),
        (ply("ascii", "0 0 zero", *XYZ), "no number"),
        (ply("binary_little_endian", "0 0", *XYZ), "0 vertices; the header says 1"),
        (ply("ascii", "0 0 0 1.5", *XYZ, "float probability"), "not within 0 .. 1"),
        (ply("ascii", "0 0 0 nan", *XYZ, "float probability"), "not within 0 .. 1"),
        (ply("ascii", "0 0 0", *XYZ, size="encircle: voxel size in metres x"), "'x' is no number"),
        (ply("ascii", "0 0 0", *XYZ).replace(b"vertex 1", b"face 1"), "first element is 'face'"),
        (ply("ascii", "0 0 0", *XYZ).replace(b"vertex 1", b"vertex -1"), "'vertex' -1"),
    ],
)
def test_bad_points_are_refused(data: bytes, says: str) -> None:
    with pytest.raises(BadMapFile, match=says):
        read_ply(data, 0.1)


@pytest.mark.parametrize("size", ["0", "nan", "-1"])
def test_a_voxel_size_that_is_none_is_refused(size: str) -> None:
    with pytest.raises(MapperError, match="voxel size"):
        read_ply(ply("ascii", "0 0 0", *XYZ, size=f"encircle: voxel size in metres {size}"))


def test_points_without_a_voxel_size_ask_for_one() -> None:
    with pytest.raises(BadMapFile, match="tells no voxel size"):
        read_ply(ply("ascii", "0 0 0", *XYZ))


@pytest.mark.parametrize("rows", ["0 0 0\n1e9 0 0", "0 0 0\n9000 9000 9000", "1e300 0 0"])
def test_points_that_are_too_far_apart_are_refused(rows: str) -> None:
    with pytest.raises(MapperError):
        read_ply(ply("ascii", rows, "double x", "double y", "double z"), 0.1)


@pytest.mark.parametrize(("write", "read"), [(npz_bytes, read_npz), (ply_bytes, read_ply)])
def test_damaged_files_are_read_or_refused_and_nothing_else(write, read, stored: StoredMap) -> None:
    rng = np.random.default_rng(11)
    good = write(stored)
    for _ in range(300):
        bad = bytearray(good)
        for _ in range(rng.integers(1, 4)):
            bad[rng.integers(len(bad)) if rng.random() < 0.5 else rng.integers(600)] ^= 1 << (
                rng.integers(8)
            )
        end = len(bad) if rng.random() < 0.7 else rng.integers(len(bad))
        try:
            read(bytes(bad[:end]))
        except MapperError:
            continue


@pytest.mark.parametrize("hair_m", [-2.6e-23, -1e-9, 1e-9, 0.0])
def test_a_point_a_hair_beside_a_face_has_a_voxel(hair_m: float) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    header += "property double x\nproperty double y\nproperty double z\nend_header\n"
    text = f"{header}0.01 0.01 {hair_m!r}\n0.01 0.01 {0.4 + hair_m!r}\n"
    stored = read_ply(text.encode(), 0.05)
    keys = stored.box.keys(np.array([[0.01, 0.01, hair_m], [0.01, 0.01, 0.4 + hair_m]]))
    index = 8 * stored.bricks.astype(np.int64)[:, None, :]
    known = np.nonzero(stored.log_odds >= 0)
    inside = np.stack(np.unravel_index(known[1], (8, 8, 8)), axis=1)
    found = index[known[0], 0] + inside
    np.testing.assert_array_equal(np.sort(found, axis=0), np.sort(keys, axis=0))
