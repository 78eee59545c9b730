"""A window that moves: what stays is untouched, what leaves is forgotten or kept, mirrors know."""

import numpy as np
import pytest

from schemas.geometry import Pose
from schemas.map import MapChanges
from services.mapper import brick_store
from services.mapper.box import MAX_KEY, Box
from services.mapper.errors import BadBox, BadMapFile, MapTooLarge
from services.mapper.fusion import Fusion, MemorySettings
from services.mapper.report import MAX_BRICKS, Reporter
from services.mapper.voxel_map import VoxelMap
from services.runtime.map_mirror import MapMirror, Outcome

pytestmark = pytest.mark.unit

RESOLUTION_M = 0.05
BRICK_M = 8 * RESOLUTION_M
LOW, HIGH = np.array((-1.65, -1.2, -0.8)), np.array((1.5, 1.2, 0.8))
"""Not whole bricks from the origin: the lattice of bricks has a corner of its own."""
BIG = ((-5.25, -5.2, -3.2), (5.1, 5.2, 3.2))
"""The same lattice of bricks, so large that nothing of these tests leaves it."""


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def new_map(*, archive: bool = False) -> VoxelMap:
    return VoxelMap(RESOLUTION_M, LOW, HIGH, archive=archive)


def fuse_some(rng: np.random.Generator, centre_m: np.ndarray, *maps: VoxelMap) -> None:
    """Fuse the same random cloud about a point; its rays cross the window and leave it."""
    points = centre_m + rng.normal(0.0, 1.2, (150, 3))
    for voxel_map in maps:
        voxel_map.fuse_points(points, centre_m + (0.1, 0.05, 0.02))


def fill(rng: np.random.Generator, *maps: VoxelMap) -> None:
    for _ in range(4):
        fuse_some(rng, maps[0].box.origin_m + (HIGH - LOW) / 2, *maps)


def within(big: VoxelMap, box: Box) -> np.ndarray:
    """Cut the log-odds of a box out of those of a larger one."""
    first = np.subtract(box.first_key, big.box.first_key)
    cut = tuple(slice(a, a + n) for a, n in zip(first, box.shape, strict=True))
    return big.log_odds_dense()[cut]


def test_the_window_moves_by_whole_bricks_to_where_it_is_told(rng: np.random.Generator) -> None:
    voxel_map = new_map()
    for _ in range(50):
        before, centre_m = voxel_map.box, rng.uniform(-30, 30, 3)
        voxel_map.move_to(centre_m, slack_bricks=0.0)
        moved = np.subtract(voxel_map.box.first_key, before.first_key)
        middle_m = voxel_map.box.origin_m + np.array(voxel_map.box.shape) / 2 * RESOLUTION_M
        assert (moved % 8 == 0).all()
        assert voxel_map.box.shape == before.shape
        assert (np.abs(middle_m - centre_m) <= BRICK_M / 2 + 1e-9).all()


def test_a_point_that_trembles_does_not_move_the_window(rng: np.random.Generator) -> None:
    voxel_map = new_map()
    for border in (0.5, 1.0, 1.5):
        centre_m = np.full(3, border * BRICK_M)
        voxel_map.move_to(centre_m)
        voxel_map.move_to(centre_m + 0.01)
        moves = [voxel_map.move_to(centre_m + rng.normal(0, 0.02, 3)) for _ in range(100)]
        assert not any(moves)


@pytest.mark.parametrize("archive", [False, True])
def test_what_stays_is_as_it_was_and_what_enters_is_unknown(
    rng: np.random.Generator, archive: bool
) -> None:
    for _ in range(20):
        voxel_map, still = new_map(archive=archive), new_map()
        fill(rng, voxel_map, still)
        step = rng.integers(-7, 8, 3)
        voxel_map.move_to(still.box.origin_m + (np.array(still.box.shape) / 2 + 8 * step) * 0.05, 0)
        shape = still.box.shape
        padded = np.pad(still.log_odds_dense(), 64, constant_values=np.nan)
        at = tuple(slice(64 + 8 * s, 64 + 8 * s + n) for s, n in zip(step, shape, strict=True))
        np.testing.assert_array_equal(voxel_map.log_odds_dense(), padded[at])


def test_with_an_archive_a_wandering_map_is_as_one_that_never_forgets(
    rng: np.random.Generator,
) -> None:
    rolling, centre_m = new_map(archive=True), np.zeros(3)
    big = VoxelMap(RESOLUTION_M, *BIG)
    for _ in range(60):
        centre_m = np.clip(centre_m + rng.normal(0, 0.7, 3), (-3, -3, -1.2), (3, 3, 1.2))
        rolling.move_to(centre_m)
        low_m = rolling.box.origin_m
        # What the window cannot see is not fused: only rays that end and pass inside are the same.
        points = rng.uniform(low_m, low_m + np.array(rolling.box.shape) * RESOLUTION_M, (80, 3))
        for voxel_map in (rolling, big):
            voxel_map.fuse_points(points, rolling.box.origin_m + 0.7)
        np.testing.assert_array_equal(rolling.log_odds_dense(), within(big, rolling.box))
    assert rolling.num_archived == sum(len(index) for index, _ in rolling._behind.blocks(big.box))
    assert rolling.num_archived > 100
    asked = rng.uniform(-9, 9, (20_000, 3)) * (1, 1, 0.5)
    np.testing.assert_array_equal(rolling.classify(asked), big.classify(asked))
    for mine, theirs in ((rolling.occupied(), big.occupied()), (rolling.free(), big.free())):
        for a, b in zip(in_order(mine), in_order(theirs), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)


def in_order(voxels) -> tuple[np.ndarray, np.ndarray]:
    order = np.lexsort(np.round(voxels.centres_m / RESOLUTION_M - 0.5).T)
    return voxels.centres_m[order], voxels.probability[order]


def test_without_an_archive_what_has_left_is_unknown_when_it_is_back(
    rng: np.random.Generator,
) -> None:
    voxel_map = new_map()
    fill(rng, voxel_map)
    inside = voxel_map.occupied().centres_m
    voxel_map.move_to((100.0, 0, 0), 0)
    assert voxel_map.counts().unknown == voxel_map.box.num_voxels
    assert (voxel_map.classify(inside) == 0).all()
    voxel_map.move_to((LOW + HIGH) / 2, 0)
    assert voxel_map.counts().unknown == voxel_map.box.num_voxels


def test_time_stands_still_in_the_archive() -> None:
    voxel_map = new_map(archive=True)
    point = (0.52, 0.02, 0.02)
    voxel_map.fuse_points([point], (0.0, 0.0, 0.0))
    before = voxel_map.occupied().probability
    voxel_map.decay(1.0, 10.0)
    faded = voxel_map.occupied().probability
    assert (faded < before).all()
    voxel_map.move_to((50.0, 0.0, 0.0))
    voxel_map.decay(1000.0, 10.0)
    np.testing.assert_array_equal(voxel_map.occupied().probability, faded)
    voxel_map.move_to((0.0, 0.0, 0.0))
    np.testing.assert_array_equal(voxel_map.occupied().probability, faded)
    voxel_map.decay(1000.0, 10.0)
    assert len(voxel_map.occupied().probability) == 0


def test_a_stored_map_is_taken_into_window_and_archive(rng: np.random.Generator) -> None:
    voxel_map, centre_m = new_map(archive=True), np.zeros(3)
    for x_m in (0.0, 2.0, 4.0, 6.0):
        voxel_map.move_to((x_m, 0.0, 0.0))
        fill(rng, voxel_map)
    stored = voxel_map.stored()
    for archive in (True, False):
        other = new_map(archive=archive)
        fill(rng, other)
        other.move_to((3.0, 0.4, 0.0))
        other.take_in(stored)
        voxel_map.move_to((3.0, 0.4, 0.0))
        np.testing.assert_array_equal(other.log_odds_dense(), voxel_map.log_odds_dense())
        other.move_to(centre_m)
        voxel_map.move_to(centre_m)
        assert other.num_archived == archive * voxel_map.num_archived
        if archive:
            np.testing.assert_array_equal(other.log_odds_dense(), voxel_map.log_odds_dense())


def test_a_stored_map_of_another_lattice_is_refused_and_the_map_is_as_it_was(
    rng: np.random.Generator,
) -> None:
    voxel_map = new_map()
    fill(rng, voxel_map)
    before = voxel_map.log_odds_dense()
    for low, resolution_m in ((LOW + 0.05, RESOLUTION_M), (LOW, 0.1)):
        with pytest.raises(BadMapFile, match="multiples of 8"):
            voxel_map.take_in(VoxelMap(resolution_m, low, HIGH).stored())
    np.testing.assert_array_equal(voxel_map.log_odds_dense(), before)


def test_clearing_clears_the_archive_too(rng: np.random.Generator) -> None:
    voxel_map = new_map(archive=True)
    fill(rng, voxel_map)
    voxel_map.move_to((2.0, 0.0, 0.0))
    assert voxel_map.num_archived > 0
    voxel_map.clear()
    assert voxel_map.num_archived == 0
    assert len(voxel_map.occupied().centres_m) == 0


def test_slots_of_bricks_that_leave_are_used_again(rng: np.random.Generator) -> None:
    voxel_map = new_map()
    sizes = []
    for n in range(40):
        voxel_map.move_to((0.4 * n, 0.0, 0.0))
        fill(rng, voxel_map)
        voxel_map.changes()
        sizes.append(voxel_map.num_bytes)
    assert max(sizes[20:]) == sizes[19]


def test_every_directory_of_a_store_moves_with_the_window() -> None:
    store = brick_store.BrickStore((10, 10, 3))
    directories = {
        name
        for name, array in store.bricks._asdict().items()
        if len(array) == store.bricks.slot.size
    }
    slots = {"log_odds", "free_slots"}  # These stay where they are.
    assert directories - slots == set(brick_store._ENTERS)


def test_a_window_beyond_the_lattice_is_refused_and_the_map_is_as_it_was(
    rng: np.random.Generator,
) -> None:
    voxel_map = new_map()
    fill(rng, voxel_map)
    box, before = voxel_map.box, voxel_map.log_odds_dense()
    edge_m = MAX_KEY * RESOLUTION_M
    for centre in ((edge_m, 0, 0), (0, -2 * edge_m, 0), (np.nan, 0, 0), (0, 0), (np.inf, 0, 0)):
        with pytest.raises(BadBox, match=r"within|origin"):
            voxel_map.move_to(centre)
    assert voxel_map.box == box
    np.testing.assert_array_equal(voxel_map.log_odds_dense(), before)
    with pytest.raises(BadBox, match="choose larger voxels"):
        VoxelMap(RESOLUTION_M, (edge_m, 0, 0), (edge_m + 1, 1, 1))


# What the world is told.


def told_by(voxel_map: VoxelMap, rev: int, max_rows: int | None = None) -> MapChanges:
    rows = voxel_map.changes(max_rows)
    return MapChanges.of(
        rows,
        t_ns=0,
        tick=rev,
        frame_id="world",
        rev=rev,
        base_rev=rev - 1,
        resolution_m=voxel_map.box.resolution_m,
        origin=tuple(voxel_map.box.origin_m.tolist()),
        shape_voxels=voxel_map.box.shape,
        pose=Pose(position=(0, 0, 0), orientation=(0, 0, 0, 1)),
    )


def occupied_in_window(voxel_map: VoxelMap) -> list[list[int]]:
    return np.argwhere(voxel_map.log_odds_dense() >= 0).tolist()


@pytest.mark.parametrize("archive", [False, True])
@pytest.mark.parametrize("far_m", [0.0, 50_000.0])
def test_a_mirror_that_hears_all_holds_what_the_window_holds(
    rng: np.random.Generator, archive: bool, far_m: float
) -> None:
    home_m = np.array((far_m, -far_m, 0.0))
    voxel_map, mirror, centre_m = new_map(archive=archive), MapMirror(), home_m.copy()
    for rev in range(1, 120):
        for _ in range(rng.integers(0, 4)):  # Also to and fro between two revisions.
            match rng.integers(0, 5):
                case 0 | 1:
                    centre_m = home_m + (centre_m - home_m) * 0.8 + rng.normal(0, 0.8, 3)
                    voxel_map.move_to(centre_m, float(rng.choice([0.0, 1.0])))
                case 2 | 3:
                    fuse_some(rng, centre_m, voxel_map)
                case 4:
                    voxel_map.decay(0.3, 1.0)
        if rng.random() < 0.04:
            voxel_map.clear()
        assert mirror.apply(told_by(voxel_map, rev)) is Outcome.APPLIED
        assert mirror.voxels.tolist() == occupied_in_window(voxel_map)
    assert len(mirror) > 50


def test_a_mirror_that_missed_some_is_healed_by_a_snapshot_of_what_was_told(
    rng: np.random.Generator,
) -> None:
    fusion = Fusion(new_map(), MemorySettings(memory="persistent"))
    voxel_map, reporter = fusion.voxel_map, Reporter(fusion, "world", 0)
    all_ears, deaf, centre_m, healed = MapMirror(), MapMirror(), np.zeros(3), 0
    for tick in range(60):
        fusion.begin(tick, np.eye(4))
        centre_m = centre_m + rng.normal(0.2, 0.6, 3)
        voxel_map.move_to(centre_m)
        # In the middle of an instant: the box has moved on, what was told has not.
        snapshot = reporter.full()
        if tick and deaf.rev != reporter.rev:
            assert deaf.reset(snapshot) is Outcome.APPLIED
            np.testing.assert_array_equal(deaf.voxels, all_ears.voxels)
            np.testing.assert_array_equal(deaf.centres(), all_ears.centres())
            healed += 1
        fuse_some(rng, centre_m, voxel_map)
        changes = reporter.changes(tick, tick)
        assert all_ears.apply(changes) is Outcome.APPLIED
        if rng.random() < 0.7:
            deaf.apply(changes)
    assert healed > 5
    assert all_ears.voxels.tolist() == occupied_in_window(voxel_map)


def test_changes_that_do_not_fit_one_message_come_with_the_next_revisions(
    rng: np.random.Generator,
) -> None:
    fusion = Fusion(new_map(), MemorySettings(memory="persistent"))
    reporter, mirror = Reporter(fusion, "world", 0, max_rows=2000), MapMirror()
    fill(rng, fusion.voxel_map)
    for tick in range(100):
        changes = reporter.changes(tick, tick)
        assert len(changes.voxels) <= 2000
        assert mirror.apply(changes) is Outcome.APPLIED
        healed = MapMirror()
        healed.reset(reporter.full())
        np.testing.assert_array_equal(healed.voxels, mirror.voxels)
        if tick == 5:
            assert len(mirror) < fusion.voxel_map.counts().occupied
            fusion.voxel_map.move_to((0.9, 0.0, 0.0))
    assert mirror.voxels.tolist() == occupied_in_window(fusion.voxel_map)


def test_a_box_whose_snapshot_fits_no_message_is_refused_with_the_numbers() -> None:
    voxel_map = VoxelMap(0.002, (-0.6, -0.6, 0.0), (0.6, 0.6, 1.2))
    with pytest.raises(MapTooLarge, match=rf"421875 bricks.*{MAX_BRICKS}.*0\.002 m"):
        Reporter(Fusion(voxel_map, MemorySettings()), "world", 0)


def test_a_mirror_asks_anew_when_the_lattice_is_another(rng: np.random.Generator) -> None:
    voxel_map, mirror = new_map(), MapMirror()
    fill(rng, voxel_map)
    mirror.apply(told_by(voxel_map, 1))
    changes = told_by(voxel_map, 2)
    x, y, z = changes.origin
    for foreign in ({"resolution_m": 0.04}, {"origin": (x + 0.02, y, z)}):
        assert mirror.apply(changes.model_copy(update=foreign)) is Outcome.GAP
        assert mirror.rev == 1
    assert mirror.apply(changes) is Outcome.APPLIED
