"""Our `.bt` and `.ot` are OctoMap's, byte for byte, and a bad one costs nothing but an error."""

import tracemalloc

import numpy as np
import pytest
from pyoctomap import ColorOcTree, OcTree

from services.mapper.box import Box
from services.mapper.errors import BadMapFile, MapperError, MapTooLarge
from services.mapper.octree_file import bt_bytes, ot_bytes, read_bt, read_ot
from services.mapper.sensor_model import LOG_ODDS_SCALE, SensorModel
from services.mapper.stored_map import StoredMap
from services.mapper.voxel_map import VoxelMap
from tests.octomap_reference import log_odds_in
from tests.octree_reference import (
    bt_body,
    ot_body,
    random_map,
    size_of,
    tree_of,
    voxels_of,
)

pytestmark = pytest.mark.unit

BOXES = [
    Box(0.05, (-16, -8, 0), (4, 2, 2)),  # on the octree's own bricks, across the origin.
    Box(0.05, (-13, 5, -3), (3, 3, 2)),
    Box(0.05, (-1, -1, -1), (2, 2, 2)),
    Box(0.05, (-32768, 32752, 100), (2, 2, 1)),  # at the ends of OctoMap's keys.
]
BT, OT = "# Octomap OcTree binary file\n", "# Octomap OcTree file\n"


def body(data: bytes) -> bytes:
    return data.split(b"\ndata\n", 1)[1]


def size(data: bytes) -> int:
    return int(data.split(b"\nsize ", 1)[1].split(b"\n", 1)[0])


def classes(stored: StoredMap) -> StoredMap:
    """The map whose log-odds are 0 where it is occupied and -1 where it is free."""
    known = stored.log_odds != -32768
    told = np.where(known, np.where(stored.log_odds >= 0, 0, -1), -32768).astype(np.int16)
    return StoredMap(stored.box, stored.sensor, stored.bricks, told)


@pytest.mark.parametrize("box", BOXES, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_the_files_are_those_of_the_recursive_octree(box: Box, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for colored in (False, True):
        stored = random_map(rng, box, colored)
        tree = tree_of(voxels_of(stored))
        data = ot_bytes(stored)
        assert body(data) == ot_body(tree, colored)
        assert size(data) == size_of(tree)
        tree = tree_of(voxels_of(classes(stored)))
        data = bt_bytes(stored)
        assert body(data) == bt_body(tree)
        assert size(data) == size_of(tree)


@pytest.mark.parametrize("box", BOXES, ids=str)
@pytest.mark.parametrize("colored", [False, True])
def test_what_is_written_is_read_back_voxel_by_voxel(box: Box, colored: bool) -> None:
    stored = random_map(np.random.default_rng(5), box, colored)
    full = read_ot(ot_bytes(stored))
    assert voxels_of(full) == voxels_of(stored)
    assert full.box.resolution_m == box.resolution_m
    assert ot_bytes(full) == ot_bytes(stored)
    _, _, low, high = SensorModel().fixed_point()
    free_or_occupied = {key: high if v >= 0 else low for key, (v, _) in voxels_of(stored).items()}
    assert {key: v for key, (v, _) in voxels_of(read_bt(bt_bytes(stored))).items()} == (
        free_or_occupied
    )
    assert bt_bytes(read_bt(bt_bytes(stored))) == bt_bytes(stored)


@pytest.mark.parametrize("box", BOXES[:3], ids=str)
def test_octomap_reads_our_files_and_writes_them_again_to_the_last_bit(box: Box, tmp_path) -> None:
    stored = random_map(np.random.default_rng(6), box, colored=False)
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    ours.write_bytes(bt_bytes(stored))
    tree = OcTree(1.0)
    assert tree.readBinary(str(ours))
    tree.writeBinary(str(theirs))
    assert theirs.read_bytes() == ours.read_bytes()
    ours.write_bytes(ot_bytes(stored))
    tree = OcTree(1.0).read(str(ours))
    tree.updateInnerOccupancy()
    tree.write(str(theirs))
    assert theirs.read_bytes() == ours.read_bytes()


def test_octomap_reads_our_colors_and_averages_them_as_we_do(tmp_path) -> None:
    stored = random_map(np.random.default_rng(7), BOXES[1], colored=True)
    ours, theirs = tmp_path / "ours.ot", tmp_path / "theirs.ot"
    ours.write_bytes(ot_bytes(stored))
    tree = ColorOcTree(1.0).read(str(ours))
    tree.updateInnerOccupancy()
    tree.write(str(theirs))
    assert theirs.read_bytes() == ours.read_bytes()


def scans(rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points and origins well within the box, in single precision as OctoMap takes them."""
    low, high = (-0.3, -0.26, -0.1), (0.3, 0.26, 0.12)
    return [
        (
            rng.uniform(low, high, (1500, 3)).astype(np.float32).astype(float),
            rng.uniform(low, high).astype(np.float32).astype(float),
        )
        for _ in range(4)
    ]


@pytest.mark.parametrize("corner", [(-0.32, -0.32, -0.16), (-0.33, -0.29, -0.11)])
@pytest.mark.parametrize("seed", range(2))
def test_the_exact_integrators_files_are_those_of_octomaps_own_tree(
    corner: tuple[float, float, float], seed: int, tmp_path
) -> None:
    """Log-odds, too: OctoMap is given our sensor model as fixed point has it, which floats hold."""
    ours, tree = VoxelMap(0.01, corner, (0.32, 0.32, 0.16)), OcTree(0.01)
    hit, miss, low, high = (
        1.0 / (1.0 + np.exp(-value / LOG_ODDS_SCALE)) for value in ours.sensor.fixed_point()
    )
    tree.setProbHit(hit)
    tree.setProbMiss(miss)
    tree.setClampingThresMin(low)
    tree.setClampingThresMax(high)
    for points, origin in scans(np.random.default_rng(seed)):
        ours.fuse_points(points, origin)
        tree.insertPointCloud(points, origin, -1.0, False, True)
    tree.write(str(tmp_path / "theirs.ot"))
    tree.writeBinary(str(tmp_path / "theirs.bt"))
    assert ot_bytes(ours.stored()) == (tmp_path / "theirs.ot").read_bytes()
    assert bt_bytes(ours.stored()) == (tmp_path / "theirs.bt").read_bytes()


def test_octomaps_own_files_are_read_and_written_again(tmp_path) -> None:
    tree = OcTree(0.02)
    for points, origin in scans(np.random.default_rng(9)):
        tree.insertPointCloud(points, origin, -1.0, False, True)
    tree.write(str(tmp_path / "theirs.ot"))
    theirs = (tmp_path / "theirs.ot").read_bytes()
    stored = read_ot(theirs)
    np.testing.assert_allclose(
        VoxelMap.from_stored(stored).log_odds_dense(), log_odds_in(tree, stored.box), atol=1e-4
    )
    # Its log-odds are no multiples of 1/8192: some that differ in their last bits become equal.
    assert 0.99 * len(theirs) < len(ot_bytes(stored)) <= len(theirs)
    tree.writeBinary(str(tmp_path / "theirs.bt"))  # forgets all but the classes.
    theirs = (tmp_path / "theirs.bt").read_bytes()
    assert bt_bytes(read_bt(theirs)) == theirs


def test_an_empty_map_is_octomaps_empty_tree(tmp_path) -> None:
    empty = VoxelMap(0.1, (0, 0, 0), (1, 1, 1)).stored()
    OcTree(0.1).writeBinary(str(tmp_path / "bt"))
    OcTree(0.1).write(str(tmp_path / "ot"))
    assert bt_bytes(empty) == (tmp_path / "bt").read_bytes()
    assert ot_bytes(empty) == (tmp_path / "ot").read_bytes()
    assert len(read_bt(bt_bytes(empty)).bricks) == len(read_ot(ot_bytes(empty)).bricks) == 0


@pytest.mark.parametrize("resolution", [0.01, 1 / 3, 0.0123456789, 1e-5, 10.0])
def test_the_voxel_size_is_read_back_exactly(resolution: float) -> None:
    box = Box(resolution, (0, 0, 0), (1, 1, 1))
    stored = random_map(np.random.default_rng(1), box, colored=False)
    assert read_bt(bt_bytes(stored)).box.resolution_m == resolution
    assert read_ot(ot_bytes(stored)).box.resolution_m == resolution


def test_log_odds_beyond_our_range_are_held_at_its_end() -> None:
    record = np.array([(50.0, 0)], [("log_odds", "<f4"), ("children", "u1")])
    chain = np.array([(9.0, 1)] * 16, record.dtype)
    head = f"{OT}id OcTree\nsize 17\nres 0.1\ndata\n".encode()
    (voxel,) = voxels_of(read_ot(head + chain.tobytes() + record.tobytes())).values()
    assert voxel[0] == 32767


def test_a_map_that_octomaps_keys_cannot_hold_is_refused() -> None:
    stored = random_map(np.random.default_rng(1), Box(0.1, (32764, 0, 0), (4, 4, 1)), False)
    with pytest.raises(MapTooLarge, match=r"beyond OctoMap's 32768 voxels \(3276\.8 m\)"):
        bt_bytes(stored)


def file(first: str, res: object, size: object, data: bytes, kind: str = "OcTree") -> bytes:
    return f"{first}id {kind}\nsize {size}\nres {res}\ndata\n".encode() + data


def words(*values: int) -> bytes:
    return np.array(values, "<u2").tobytes()


def nodes(*values: tuple[float, int]) -> bytes:
    return np.array(list(values), [("log_odds", "<f4"), ("children", "u1")]).tobytes()


INNER = 3  # the first child has children, and there are no others.
LEAF = 1


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "begins b''"),
        (b"\x03\x00\x00\x00", "must begin '# Octomap OcTree binary file'"),
        (file(OT, 0.1, 1, nodes((0.0, 0))), "must begin"),
        (BT.encode() + b"id OcTree\nsize 0\nres 0.1\n", "no line 'data'"),
        (BT.encode() + b"#" * 100_000, "no line 'data'"),
        (file(BT, 0.1, 2, words(LEAF), "Tree"), "id 'Tree'; known: OcTree, ColorOcTree"),
        (file(BT, 0, 2, words(LEAF)), r"res 0\.0 must be positive"),
        (file(BT, "nan", 2, words(LEAF)), "res nan must be positive"),
        (file(BT, "inf", 2, words(LEAF)), "res inf must be positive"),
        (file(BT, "-0.1", 2, words(LEAF)), r"res -0\.1 must be positive"),
        (file(BT, "big", 2, words(LEAF)), "no usable size and res"),
        (file(BT, 0.1, -2, words(LEAF)), "size -2 must not be negative"),
        (file(BT, 0.1, 10**30, words(*[INNER] * 15, LEAF)), "17 .*nodes.*1000000000"),
        (file(BT, 0.1, 16, words(*[INNER] * 15, LEAF)), "17 nodes; the header says 16"),
        (file(BT, 0.1, 17, words(*[INNER] * 15)), "node 15 is missing: the file is cut short"),
        (file(BT, 0.1, 17, words(*[INNER] * 15, LEAF)[:-1]), "31 bytes"),
        (file(BT, 0.1, 18, words(*[INNER] * 16, LEAF)), "node 16 lies below depth 16"),
        (file(BT, 0.1, 17, words(*[INNER] * 15, LEAF, LEAF)), "2 bytes follow the last node"),
    ],
)
def test_a_bad_bt_is_refused(data: bytes, says: str) -> None:
    with pytest.raises(BadMapFile, match=says):
        read_bt(data)


DOWN = [(0.0, 1)] * 16


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (file(BT, 0.1, 1, b""), "must begin '# Octomap OcTree file'"),
        (file(OT, 0.1, 17, nodes(*DOWN)), "80 bytes of nodes.*take 85"),
        (file(OT, 0.1, 16, nodes(*DOWN)), "node 16 is missing"),
        (file(OT, 0.1, 10**30, nodes(*DOWN)), "10+ nodes"),
        (file(OT, 0.1, 18, nodes(*DOWN, (0.0, 1), (0.0, 0))), "node 16 lies below depth 16"),
        (file(OT, 0.1, 18, nodes(*DOWN, (0.0, 0), (0.0, 0))), "5 bytes follow the last node"),
        (file(OT, 0.1, 17, nodes(*DOWN, (np.nan, 0))), "not finite"),
        (file(OT, 0.1, 17, nodes(*DOWN, (np.inf, 0))), "not finite"),
        (file(OT, 0.1, 17, nodes(*DOWN, (1.0, 0)), "ColorOcTree"), "85 bytes.*take 136"),
        (file(OT, 0.1, 17, nodes(*DOWN, (1.0, 0)), "CountingOcTree"), "id 'CountingOcTree'"),
    ],
)
def test_a_bad_ot_is_refused(data: bytes, says: str) -> None:
    with pytest.raises(BadMapFile, match=says):
        read_ot(data)


@pytest.mark.parametrize(
    ("data", "read"),
    [
        (file(OT, 0.1, 1, nodes((1.0, 0))), read_ot),  # everything there is.
        (file(BT, 0.1, 2, words(LEAF)), read_bt),  # an eighth of it.
        (file(BT, 0.1, 7, words(*[INNER] * 5, LEAF)), read_bt),  # 1024^3 voxels.
        (file(BT, 0.1, 3, words(LEAF | LEAF << 14)), read_bt),
    ],
)
def test_few_bytes_that_mean_very_many_voxels_are_refused_and_take_no_memory(data, read) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(MapTooLarge, match="GiB"):
            read(data)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_a_leaf_of_many_voxels_that_still_fits_is_read() -> None:
    stored = read_bt(file(BT, 0.1, 10, words(*[INNER] * 8, LEAF)))
    assert stored.box.num_bricks == (16, 16, 16)
    assert stored.bricks.shape == (16**3, 3)
    assert (stored.log_odds == SensorModel().fixed_point()[2]).all()


@pytest.mark.parametrize(("write", "read"), [(bt_bytes, read_bt), (ot_bytes, read_ot)])
@pytest.mark.parametrize("colored", [False, True])
def test_damaged_files_are_read_or_refused_and_nothing_else(write, read, colored: bool) -> None:
    rng = np.random.default_rng(11)
    good = write(random_map(rng, BOXES[2], colored))
    for _ in range(300):
        bad = bytearray(good)
        for _ in range(rng.integers(1, 4)):
            bad[rng.integers(len(bad))] = rng.integers(256)
        end = len(bad) if rng.random() < 0.7 else rng.integers(len(bad))
        try:
            read(bytes(bad[:end]))
        except MapperError:
            continue
