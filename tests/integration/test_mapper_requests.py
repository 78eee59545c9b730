"""Every verb of `ctl/mapper/`, asked of a mapper on a real bus."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from schemas.camera import ColorImage
from schemas.topics import CAMERA_COLOR, MAP_FULL
from services.kernels.rigid import apply
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up
from services.runtime.bus import Bus
from services.runtime.errors import CommandFailed
from services.runtime.map_mirror import MapMirror, Outcome
from tests.integration.mapper_world import WAIT_S, World, expected_map, target_pose, worlds

pytestmark = pytest.mark.integration

OpenBus = Callable[..., Bus]


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    warm_up()


@pytest.fixture
def start(open_bus: OpenBus) -> Iterator[Callable[..., World]]:
    with worlds(open_bus) as begin:
        yield begin


@pytest.fixture
def world(start) -> World:
    """A mapper that has fused tick 1 of three cameras, and whoever asks it."""
    made = start()
    made.instant(0, 0, 1, 2)
    made.instant(1, 0, 1, 2)
    return made


def ask(world: World, verb: str, **params: Any) -> dict[str, Any]:
    return world.bus.request("mapper", verb, params, timeout_s=WAIT_S)


def packed(array: np.ndarray) -> dict[str, Any]:
    return {"dtype": array.dtype.str, "shape": list(array.shape), "data": array.tobytes()}


def unpacked(answer: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(answer["data"], answer["dtype"]).reshape(answer["shape"])


def points_around(count: int = 500) -> np.ndarray:
    """In the map's frame, single precision."""
    points = np.random.default_rng(3).uniform((-0.7, -0.7, -0.2), (0.7, 0.7, 0.8), (count, 3))
    return points.astype(np.float32).astype(np.float64)


@pytest.fixture
def expected() -> VoxelMap:
    return expected_map(1, (0, 1, 2))


def test_points_are_classified_in_either_frame_and_either_form(world, expected) -> None:
    points = points_around()
    classes = expected.classify(points)
    assert set(classes) == {0, 1, 2}
    answer = ask(world, "classify", points_m=points.tolist())
    assert (answer["frame"], answer["rev"], answer["tick"]) == ("map", 2, 1)
    assert answer["classes"] == classes.tolist()
    for dtype in ("<f4", "<f8"):
        answer = ask(world, "classify", points_m=packed(points.astype(dtype)))
        np.testing.assert_array_equal(unpacked(answer["classes"]), classes)
    in_world = apply(target_pose(1), points)
    answer = ask(world, "classify", points_m=packed(in_world), frame="world")
    assert answer["frame"] == "world"
    assert (unpacked(answer["classes"]) == classes).mean() > 0.99  # but for points on borders.


def test_80000_points_fit_a_request(world, expected) -> None:
    points = points_around(80_000)
    answer = ask(world, "classify", points_m=packed(points.astype("<f4")))
    np.testing.assert_array_equal(unpacked(answer["classes"]), expected.classify(points))


def test_rays_are_cast_in_either_frame_and_either_form(world, expected) -> None:
    origins = points_around(300)
    directions = -origins
    hits = expected.cast_rays(origins, directions)
    assert 10 < (hits.outcome == 2).sum() < 290
    answer = ask(world, "cast_rays", origins_m=origins.tolist(), directions=directions.tolist())
    assert answer["outcome"] == hits.outcome.tolist()
    np.testing.assert_array_equal(answer["points_m"], hits.points_m)
    np.testing.assert_array_equal(answer["distance_m"], hits.distance_m)
    T = target_pose(1)
    answer = ask(
        world,
        "cast_rays",
        origins_m=packed(apply(T, origins)),
        directions=packed(directions),
        frame="world",
    )
    same = unpacked(answer["outcome"]) == hits.outcome
    assert same.mean() > 0.98
    met = same & (hits.outcome == 2)
    centres = apply(T, hits.points_m[met])
    assert np.isclose(unpacked(answer["points_m"])[met], centres, atol=1e-4).mean() > 0.98


def test_a_ray_that_is_none_is_counted_and_ranges_and_unknown_space_end_others(world) -> None:
    answer = ask(
        world,
        "cast_rays",
        origins_m=[[0, 0, 0.3]] * 2,
        directions=[[0, 0, 0], [0, 0, 1]],
        max_range_m=0.05,
        unknown_stops=True,
    )
    assert answer["num_invalid"] == 1
    assert answer["outcome"][0] == 255
    assert answer["outcome"][1] in (0, 1, 2)


def test_distances_of_points_and_of_a_box(world, expected) -> None:
    points = points_around(200)
    answer = ask(world, "distance", points_m=points.tolist(), reach_m=0.4)
    np.testing.assert_allclose(answer["distance_m"], expected.distance(points, 0.4))
    in_world = apply(target_pose(1), points).tolist()
    answer = ask(world, "distance", points_m=in_world, reach_m=0.4, frame="world")
    np.testing.assert_allclose(answer["distance_m"], expected.distance(points, 0.4), atol=1e-9)
    bounds = [[-0.1, -0.1, 0.1], [0.2, 0.1, 0.3]]
    answer = ask(world, "distance", bounds_m=bounds, unknown_is="occupied")
    field, origin_m = expected.distance_field(bounds, 1.0, "occupied")
    np.testing.assert_array_equal(unpacked(answer["distance_m"]), field)
    np.testing.assert_allclose(answer["origin_m"], origin_m)


def test_entropy_of_the_box_and_of_a_part(world, expected) -> None:
    bounds = [[-0.1, -0.1, 0.1], [0.2, 0.1, 0.3]]
    whole, part = ask(world, "entropy"), ask(world, "entropy", bounds_m=bounds)
    assert whole["entropy_bits"] == pytest.approx(expected.entropy_bits())
    assert whole["num_voxels"] == expected.box.num_voxels
    assert part["entropy_bits"] == pytest.approx(expected.entropy_bits(bounds))
    assert part["num_voxels"] == 30 * 20 * 20


def test_a_map_is_saved_and_gone_on_with_and_mirrors_follow(start, tmp_path: Path) -> None:
    world = start(cameras=1, files=tmp_path, memory="persistent")
    world.instant(0, 0)
    for name in ("map.ply", "map.npz", "map.bt", str(tmp_path / "absolute.ot")):
        saved = ask(world, "save", path=name)
        assert Path(saved["path"]) == tmp_path / name
    stored = VoxelMap.load(tmp_path / "map.npz")
    assert stored.counts().occupied == saved["occupied"] > 0
    mirror = MapMirror()
    mirror.apply(world.instant(1, 0)[0])
    assert ask(world, "reset")["occupied"] == 0
    assert ask(world, "load", path="map.npz")["occupied"] == saved["occupied"]
    changes, summary = world.instant(2, 0)
    assert changes.base_rev == 0
    assert mirror.apply(changes) is Outcome.APPLIED
    assert len(mirror) == summary.num_occupied
    late = MapMirror()
    late.reset(world.bus.fetch(MAP_FULL))
    np.testing.assert_array_equal(late.voxels, mirror.voxels)
    changes, summary = world.instant(3, 0)
    assert changes.base_rev == changes.rev - 1
    assert mirror.apply(changes) is Outcome.APPLIED
    assert len(mirror) == summary.num_occupied


def test_a_map_of_another_box_is_gone_on_with(start, tmp_path: Path) -> None:
    other = VoxelMap(0.05, (-1, -1, -1), (1, 1, 1))
    other.fuse_points([(0.5, 0.5, 0.5)], (0, 0, 0))
    other.save(tmp_path / "other.npz")
    world = start(cameras=1, files=tmp_path, memory="persistent")
    mirror = MapMirror()
    mirror.apply(world.instant(0, 0)[0])
    assert ask(world, "load", path="other.npz")["voxel_size"] == 0.05
    assert ask(world, "classify", points_m=[[0.5, 0.5, 0.5]])["classes"] == [2]
    changes, summary = world.instant(1, 0)
    assert mirror.apply(changes) is Outcome.APPLIED
    assert (changes.resolution_m, changes.shape_voxels) == (0.05, other.box.shape)
    assert len(mirror) == summary.num_occupied > 0


def test_requests_wait_for_the_end_of_the_instant_and_see_all_of_it(start, tmp_path: Path) -> None:
    world = start(cameras=3, files=tmp_path, deadline_s=30.0)
    world.instant(0, 0, 1, 2)
    before = ask(world, "get")["occupied"]
    world.tell_target(1)
    world.send(1, 0)
    until = time.monotonic() + WAIT_S
    while ask(world, "get")["occupied"] == before:
        assert time.monotonic() < until, "the first cloud was never fused"
    answers: dict[str, dict[str, Any]] = {}
    askers = [
        threading.Thread(target=lambda: answers.update(save=ask(world, "save", path="map.npz"))),
        threading.Thread(target=lambda: answers.update(entropy=ask(world, "entropy"))),
    ]
    for asker in askers:
        asker.start()
    askers[0].join(0.3)
    assert answers == {}
    world.send(1, 1, 2)
    summary = world.answer()[1]
    for asker in askers:
        asker.join(WAIT_S)
    assert answers["save"]["tick"] == answers["entropy"]["tick"] == 1
    saved = VoxelMap.load(tmp_path / "map.npz").counts()
    assert (saved.free, saved.occupied) == (summary.num_free, summary.num_occupied)
    assert saved == expected_map(1, (0, 1, 2)).counts()


def test_memory_is_set_from_the_next_instant_on(start) -> None:
    world = start(cameras=1)
    _, first = world.instant(0, 0)
    answer = ask(world, "set", memory="persistent", frames_to_clear=2, frames_to_appear=1)
    assert (answer["memory"], answer["frames_to_clear"]) == ("persistent", 2)
    assert answer["half_life_s"] == 1.0
    assert world.instant(1, 0)[1].num_free > first.num_free
    assert ask(world, "set", memory="decay", half_life_s=0.5)["half_life_s"] == 0.5
    assert world.instant(2, 0)[1].memory == "decay"


POINT = [[0.0, 0.0, 0.0]]


WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("set", {"memory": "elephant"}, "persistent"),
    ("set", {"memroy": "instant"}, "known: memory, half_life_s"),
    ("set", {"half_life_s": -1.0}, "greater than 0"),
    ("set", {"half_life_s": 0.0}, "greater than 0"),
    ("set", {"frames_to_clear": 0}, "greater than or equal to 1"),
    ("get", {"everything": True}, "known: none"),
    ("reset", {"really": True}, "known: none"),
    ("classify", {}, "points_m: Field required"),
    ("classify", {"points_m": POINT, "frame": "moon"}, "'map' or 'world'"),
    ("classify", {"points": POINT}, "known: points_m, frame"),
    ("classify", {"points_m": [[0.0, 0.0]]}, r"must be \(N, 3\)"),
    ("classify", {"points_m": [["x", 0.0, 0.0]]}, "must be numbers"),
    ("classify", {"points_m": "everywhere"}, "must be numbers"),
    ("classify", {"points_m": POINT * 5000}, "4096"),
    ("classify", {"points_m": packed(np.zeros((4, 3), "<i4"))}, "'<f4' or '<f8'"),
    ("classify", {"points_m": packed(np.zeros((4, 2)))}, "shape.1"),
    ("classify", {"points_m": {**packed(np.zeros((4, 3))), "shape": [5, 3]}}, "needs 120 byt"),
    ("classify", {"points_m": {**packed(np.zeros((4, 3))), "shape": [-4, 3]}}, "equal to 0"),
    ("classify", {"points_m": packed(np.zeros((60_000, 3)))}, "1048576"),
    ("cast_rays", {"origins_m": POINT}, "directions: Field required"),
    ("cast_rays", {"origins_m": POINT, "directions": POINT * 2}, "1 origins and 2 directions"),
    ("cast_rays", {"origins_m": POINT, "directions": POINT, "max_range_m": 0.0}, "greater"),
    ("distance", {}, "points_m or bounds_m"),
    ("distance", {"points_m": POINT, "bounds_m": [[0, 0, 0], [1, 1, 1]]}, "not both"),
    ("distance", {"points_m": POINT, "unknown_is": "maybe"}, "'free' or 'occupied'"),
    ("distance", {"points_m": POINT, "reach_m": np.inf}, "finite"),
    ("distance", {"bounds_m": [[0, 0, 0], [1, 1, 0]]}, "volume"),
    ("distance", {"bounds_m": [[5, 5, 5], [6, 6, 6]]}, "outside the box"),
    ("distance", {"bounds_m": [[-1, -1, -1], [1, 1, 1]]}, "1152000 voxels.*at most 261120"),
    ("distance", {"bounds_m": [[0, 0, 0], [1, 1, 1]], "frame": "world"}, "in 'world' ask by"),
    ("entropy", {"bounds_m": [[0, 0, 0], [np.nan, 1, 1]]}, "finite"),
    ("save", {}, "path: Field required"),
    ("save", {"path": ""}, "at least 1 character"),
    ("save", {"path": "map.pcd"}, r"known: \.npz, \.ply"),
    ("save", {"path": "/etc/passwd"}, "outside .*setting `files`"),
    ("save", {"path": "../map.ply"}, "outside"),
    ("save", {"path": "link/map.ply"}, "outside"),
    ("save", {"path": "nowhere/map.ply"}, "nowhere is no folder"),
    ("save", {"path": "folder.npz"}, "no file"),
    ("save", {"path": "map\0.ply"}, "null"),
    ("load", {"path": "/etc/passwd"}, "outside"),
    ("load", {"path": "missing.npz"}, "no file"),
    ("load", {"path": "damaged.npz"}, "damaged"),
    ("load", {"path": "notes.txt"}, "known"),
]


@pytest.mark.parametrize("verb", sorted({verb for verb, _, _ in WRONG}))
def test_wrong_requests_are_refused_counted_and_change_nothing(
    start, tmp_path: Path, verb: str
) -> None:
    (tmp_path / "folder.npz").mkdir()
    (tmp_path / "damaged.npz").write_bytes(b"PK\x03\x04 cut")
    (tmp_path / "notes.txt").write_text("no map")
    (tmp_path / "link").symlink_to("/tmp")
    world = start(cameras=1, files=tmp_path, memory="persistent")
    world.instant(0, 0)
    before, state = world.bus.fetch(MAP_FULL), ask(world, "get")
    cases = [(params, says) for asked, params, says in WRONG if asked == verb]
    for count, (params, says) in enumerate(cases, start=1):
        with pytest.raises(CommandFailed, match=says):
            ask(world, verb, **params)
        refused = [m.bad for m in world.mapper.meters if m.key == f"ctl/mapper/{verb}"]
        assert refused == [count]
        assert ask(world, "get") == state
    after = world.bus.fetch(MAP_FULL)
    np.testing.assert_array_equal(after.array, before.array)


def test_a_map_cannot_be_loaded_where_it_would_be_forgotten_at_once(start, tmp_path: Path) -> None:
    world = start(cameras=1, files=tmp_path)
    world.instant(0, 0)
    ask(world, "save", path="map.npz")
    with pytest.raises(CommandFailed, match="set memory to 'persistent' or 'decay' first"):
        ask(world, "load", path="map.npz")


def test_pictures_color_the_map_and_clouds_without_one_are_counted(start, tmp_path: Path) -> None:
    world = start(cameras=2, files=tmp_path, color=True)
    until = time.monotonic() + WAIT_S
    while not all(bus.matching(CAMERA_COLOR, i) for i, bus in enumerate(world.cameras)):
        assert time.monotonic() < until, "nobody wants pictures"
    red = np.full((48, 64, 3), (0, 0, 255), np.uint8)
    jpeg = cv2.imencode(".jpg", red)[1].reshape(-1)
    optics = {"width": 64, "height": 48}
    for tick in range(2):
        for camera, bus in enumerate(world.cameras):
            stamp = {"t_ns": 0, "tick": tick, "frame_id": "cam", "camera": camera}
            bus.publish(CAMERA_COLOR, ColorImage.of(jpeg, **stamp, **optics), camera=camera)
        counted = [m for m in world.mapper.meters if m.key.endswith("/color")]
        while sum(m.count for m in counted) < 2 * (tick + 1):
            assert time.monotonic() < until, "a picture was lost"
            counted = [m for m in world.mapper.meters if m.key.endswith("/color")]
        world.instant(tick, 0, 1)
    state = ask(world, "get")
    assert (state["is_colored"], state["clouds_without_picture"]) == (True, 0)
    ask(world, "save", path="map.npz")
    colors = VoxelMap.load(tmp_path / "map.npz").colors()
    assert len(colors) > 100
    assert (np.abs(colors.astype(int) - (254, 0, 0)) < 4).all(axis=1).mean() > 0.9
    world.instant(2, 0, 1)
    assert ask(world, "get")["clouds_without_picture"] == 2
