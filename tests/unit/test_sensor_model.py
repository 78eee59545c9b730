"""Frames to clear and to appear are what they say, in fixed point and on the map."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.mapper.errors import BadSensorModel
from services.mapper.fusion import Fusion, MemorySettings
from services.mapper.sensor_model import LOG_ODDS_SCALE, MOST_FRAMES, SensorModel
from services.mapper.settings import MapperSettings
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

FRAMES = st.integers(1, MOST_FRAMES)


def looks_until(occupied: bool, start: int, update: int, low: int, high: int) -> int:
    """Count updates until the class is what is waited for."""
    value, count = start, 0
    while (value >= 0) != occupied:
        value, count = min(max(value + update, low), high), count + 1
    return count


def assert_law(frames_to_clear: int, frames_to_appear: int) -> None:
    hit, miss, low, high = SensorModel.from_frames(frames_to_clear, frames_to_appear).fixed_point()
    assert low < 0 <= high < 1 << 15
    assert -low < 1 << 15
    assert looks_until(False, high, miss, low, high) == frames_to_clear
    assert looks_until(True, low, hit, low, high) == frames_to_appear
    assert min(max(hit, low), high) >= 0 > min(max(miss, low), high)


def test_a_clamp_is_crossed_in_exactly_so_many_frames_up_to_fifty() -> None:
    for frames_to_clear, frames_to_appear in itertools.product(range(1, 51), repeat=2):
        assert_law(frames_to_clear, frames_to_appear)


@given(FRAMES, FRAMES)
@settings(max_examples=60, deadline=None)
def test_a_clamp_is_crossed_in_exactly_so_many_frames(to_clear: int, to_appear: int) -> None:
    assert_law(to_clear, to_appear)


@given(FRAMES, FRAMES, st.lists(st.booleans(), max_size=60))
@settings(max_examples=100, deadline=None)
def test_whatever_was_seen_before_so_many_frames_in_a_row_are_enough(
    to_clear: int, to_appear: int, history: list[bool]
) -> None:
    hit, miss, low, high = SensorModel.from_frames(to_clear, to_appear).fixed_point()
    value = 0
    for was_hit in history:
        value = min(max(value + (hit if was_hit else miss), low), high)
    assert looks_until(False, value, miss, low, high) <= to_clear
    assert looks_until(True, value, hit, low, high) <= to_appear


def test_octomap_needs_nine_misses_and_three_hits() -> None:
    hit, miss, low, high = SensorModel().fixed_point()
    assert looks_until(False, high, miss, low, high) == 9
    assert looks_until(True, low, hit, low, high) == 3


def test_what_no_frames_are_given_for_stays_as_it_is() -> None:
    base = SensorModel(hit=0.8, miss=0.3, min=0.1, max=0.9)
    assert base.with_frames() == base
    cleared, appeared = base.with_frames(2), base.with_frames(None, 2)
    assert (cleared.hit, cleared.min) == (base.hit, base.min)
    assert (appeared.miss, appeared.max) == (base.miss, base.max)


@pytest.mark.parametrize("frames", [(0, 1), (1, 0), (-3, 1), (1, MOST_FRAMES + 1)])
def test_a_number_of_frames_that_is_none_is_refused_with_its_range(frames) -> None:
    with pytest.raises(BadSensorModel, match=r"frames_to_\w+ -?\d+ must lie in 1 \.\. 1000"):
        SensorModel.from_frames(*frames)


@pytest.mark.parametrize("odds", [{"min": 0.49999}, {"miss": 0.49999}, {"hit": 0.50001}])
def test_odds_that_are_even_once_rounded_are_refused(odds: dict[str, float]) -> None:
    with pytest.raises(BadSensorModel, match=r"must differ from 0\.5 by 1\.5e-05"):
        SensorModel(**odds)
    further = {name: 0.5 + 2 * (value - 0.5) for name, value in odds.items()}
    hit, miss, low, _ = SensorModel(**further).fixed_point()
    assert miss < 0 < hit
    assert low < 0


RESOLUTION_M = 0.05
POINT, EYE = np.array([(0.025, 0.025, 0.225)]), np.array((0.025, 0.025, 0.625))
BEHIND = np.array([(0.025, 0.025, 0.025)])
PINHOLE = (40.0, 40.0, 15.5, 11.5)
T_DOWN = np.array([[1.0, 0, 0, 0.025], [0, -1, 0, 0.025], [0, 0, -1, 0.625], [0, 0, 0, 1]])


def look(voxels: VoxelMap, at_m: np.ndarray, organised: bool) -> None:
    """One frame of a camera above, in which rays return from a height."""
    if organised:
        depth_mm = round((EYE[2] - at_m[0, 2]) * 1000)
        voxels.fuse_depth(np.full((24, 32), depth_mm, np.uint16), PINHOLE, T_DOWN)
    else:
        voxels.fuse_points(at_m, EYE)


@pytest.mark.parametrize("organised", [True, False])
@pytest.mark.parametrize(
    ("to_clear", "to_appear"), [(1, 1), (1, 4), (2, 1), (3, 3), (7, 2), (20, 50)]
)
def test_on_the_map_too(to_clear: int, to_appear: int, organised: bool) -> None:
    sensor = SensorModel.from_frames(to_clear, to_appear)
    voxels = VoxelMap(RESOLUTION_M, (-0.4, -0.4, 0), (0.4, 0.4, 0.4), sensor)
    says = []
    for at_m, frames in ((POINT, to_clear + 70), (BEHIND, 70), (POINT, 60)):
        for _ in range(frames):
            look(voxels, at_m, organised)
            says.append(int(voxels.classify(POINT)[0]))
    changes = np.flatnonzero(np.diff(says)) + 1
    left, came_back = to_clear + 70, to_clear + 140
    assert says[0] == 2  # What was never seen appears at once.
    assert changes.tolist() == [left + to_clear - 1, came_back + to_appear - 1]


def test_several_cameras_only_make_it_faster() -> None:
    voxels = VoxelMap(RESOLUTION_M, (-0.4, -0.4, 0), (0.4, 0.4, 0.4), SensorModel.from_frames(6, 1))
    for _ in range(9):
        look(voxels, POINT, organised=True)
    says = []
    for _ in range(2):
        for _ in range(3):
            look(voxels, BEHIND, organised=True)
        says.append(int(voxels.classify(POINT)[0]))
    assert says == [2, 1]


def test_another_model_counts_at_once_also_for_what_was_seen_before() -> None:
    voxels = VoxelMap(RESOLUTION_M, (-0.4, -0.4, 0), (0.4, 0.4, 0.4))
    for _ in range(12):
        look(voxels, POINT, organised=True)
    before, dense = voxels.counts(), voxels.log_odds_dense()
    voxels.set_sensor(SensorModel.from_frames(2, 1))
    _, _, low, high = (value / LOG_ODDS_SCALE for value in voxels.sensor.fixed_point())
    assert voxels.counts() == before
    np.testing.assert_allclose(voxels.log_odds_dense(), np.clip(dense, low, high), atol=1e-6)
    look(voxels, BEHIND, organised=True)
    assert voxels.classify(POINT)[0] == 2
    look(voxels, BEHIND, organised=False)
    assert voxels.classify(POINT)[0] == 1


def test_another_model_counts_for_what_comes_back_from_the_archive_and_from_a_file() -> None:
    voxels = VoxelMap(RESOLUTION_M, (-0.4, -0.4, 0), (0.4, 0.4, 0.4), archive=True)
    for _ in range(12):
        look(voxels, POINT, organised=True)
    counts, dense = voxels.counts(), voxels.log_odds_dense()
    voxels.move_to((9.0, 0.0, 0.2))
    voxels.set_sensor(SensorModel.from_frames(2, 1))
    _, _, low, high = (value / LOG_ODDS_SCALE for value in voxels.sensor.fixed_point())
    loaded = VoxelMap.from_stored(voxels.stored())
    voxels.move_to((0.0, 0.0, 0.2))
    assert voxels.counts() == counts
    np.testing.assert_allclose(voxels.log_odds_dense(), np.clip(dense, low, high), atol=1e-6)
    loose = loaded.log_odds_dense()
    assert (np.nanmin(loose), np.nanmax(loose)) == pytest.approx((low, high))


def test_memory_settings_count_from_the_next_instant_and_can_be_taken_back() -> None:
    chosen = MapperSettings(hit=0.8, frames_to_clear=3)
    fusion = Fusion(chosen.empty_map(), chosen.memory_settings())
    fusion.begin(0, np.eye(4))
    assert fusion.voxel_map.sensor == SensorModel(hit=0.8).with_frames(3)
    fusion.memory = MemorySettings(frames_to_appear=2)
    assert fusion.voxel_map.sensor == SensorModel(hit=0.8).with_frames(3)
    fusion.begin(1, np.eye(4))
    assert fusion.voxel_map.sensor == SensorModel(hit=0.8).with_frames(None, 2)
    fusion.memory = MemorySettings()
    fusion.begin(2, np.eye(4))
    assert fusion.voxel_map.sensor == SensorModel(hit=0.8)


def test_flags_need_a_memory() -> None:
    with pytest.raises(ValueError, match=r"dynamic with memory instant: .* persistent or decay"):
        MapperSettings(dynamic=True)
    assert MapperSettings(dynamic=True, memory="persistent").empty_map().num_dynamic == 0


@pytest.mark.parametrize(
    ("frames", "name"),
    [
        ("frames_to_clear", "miss"),
        ("frames_to_clear", "clamp_max"),
        ("frames_to_appear", "hit"),
        ("frames_to_appear", "clamp_min"),
    ],
)
def test_frames_and_the_probabilities_they_stand_for_exclude_each_other(frames, name) -> None:
    odds = {"miss": 0.3, "clamp_max": 0.9, "hit": 0.8, "clamp_min": 0.2}[name]
    with pytest.raises(ValueError, match=f"{frames} 2 and {name} {odds} exclude each other"):
        MapperSettings(**{frames: 2, name: odds})
