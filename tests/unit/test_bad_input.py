"""Bad input gets a clear error that names the value and the rule, and leaves the map as it was."""

import math
import subprocess
import sys

import numpy as np
import pytest

from services.mapper.box import Box
from services.mapper.errors import (
    BadBox,
    BadDecay,
    BadDepth,
    BadIntrinsics,
    BadPoints,
    BadPose,
    BadRows,
    MapperError,
    MapTooLarge,
)
from services.mapper.view import View
from services.mapper.voxel_map import VoxelMap

pytestmark = pytest.mark.unit

LOW, HIGH = (-0.32, -0.32, -0.16), (0.32, 0.32, 0.32)
PINHOLE = (90.0, 90.0, 39.5, 29.5)
SHAPE = (60, 80)


def looking_down(height_m: float = 0.6) -> np.ndarray:
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = height_m
    return T


@pytest.fixture
def voxels() -> VoxelMap:
    """A map that knows something, has told it, and has forgotten a little."""
    made = VoxelMap(0.02, LOW, HIGH)
    rng = np.random.default_rng(7)
    for _ in range(3):
        made.fuse_depth(rng.integers(0, 900, SHAPE).astype(np.uint16), PINHOLE, looking_down())
    made.changes()
    made.decay(0.1, 1.0)
    return made


def everything(voxel_map: VoxelMap) -> tuple:
    """All that can be asked, to the last bit."""
    known, snapshot = voxel_map.known_bricks(), voxel_map.snapshot()
    arrays = (*known, snapshot.bricks, snapshot.log_odds)
    facts = (voxel_map.box, voxel_map.sensor, voxel_map.counts(), voxel_map.num_bytes)
    return (*facts, *(array.tobytes() for array in arrays))


def moved(x_m: float) -> np.ndarray:
    T = looking_down()
    T[0, 3] = x_m
    return T


def bent(entry: float) -> np.ndarray:
    T = looking_down()
    T[0, 1] = entry
    return T


GOOD = {"depth": np.full(SHAPE, 500, np.uint16), "pinhole": PINHOLE, "T_map_camera": looking_down()}
HUGE = np.broadcast_to(np.uint16(500), (8192, 8192))


@pytest.mark.parametrize(
    ("wrong", "error", "says"),
    [
        ({"T_map_camera": bent(0.1)}, BadPose, "no rigid motion"),
        ({"T_map_camera": 2 * looking_down()}, BadPose, "no rigid motion"),
        ({"T_map_camera": bent(math.nan)}, BadPose, "finite"),
        ({"T_map_camera": moved(math.inf)}, BadPose, "finite"),
        ({"T_map_camera": moved(1e30)}, BadPose, r"within 1e\+06 m"),
        ({"T_map_camera": "here"}, BadPose, r"numbers of shape \(4, 4\)"),
        ({"T_map_camera": np.eye(4)[:3]}, BadPose, r"shape \(3, 4\)"),
        ({"depth": HUGE}, BadDepth, r"\(8192, 8192\); it must have 1 .. 16777216 pixels"),
        ({"depth": np.zeros((0, 80), np.uint16)}, BadDepth, r"\(0, 80\)"),
        ({"depth": np.zeros(SHAPE)}, BadDepth, "uint16"),
        ({"depth_scale_m": 1e-300}, BadDepth, "depth scale 1e-300 m must lie in 1e-06 .. 1 m"),
        ({"depth_scale_m": 1e300}, BadDepth, r"depth scale 1e\+300"),
        ({"depth_scale_m": 0.0}, BadDepth, "depth scale 0.0"),
        ({"depth_scale_m": None}, BadDepth, "depth scale None must be a number"),
        ({"max_range_m": "far"}, BadDepth, "maximum range 'far' must be a number"),
        ({"depth_scale_m": -0.001}, BadDepth, "depth scale -0.001"),
        ({"depth_scale_m": math.nan}, BadDepth, "depth scale nan"),
        ({"max_range_m": math.inf}, BadDepth, "maximum range inf m must be positive and at most"),
        ({"max_range_m": 0.0}, BadDepth, "maximum range 0.0"),
        ({"max_range_m": math.nan}, BadDepth, "maximum range nan"),
        ({"pinhole": (1e-300, 90.0, 0.0, 0.0)}, BadIntrinsics, "fx 1e-300"),
        ({"pinhole": (90.0, 1e300, 0.0, 0.0)}, BadIntrinsics, r"fy 1e\+300"),
        ({"pinhole": (90.0, -90.0, 0.0, 0.0)}, BadIntrinsics, "fy -90.0"),
        ({"pinhole": (90.0, 90.0, math.nan, 0.0)}, BadIntrinsics, "cx nan"),
        ({"pinhole": (90.0, 90.0, 0.0, 1e9)}, BadIntrinsics, "cy 1000000000.0"),
        ({"pinhole": None}, BadIntrinsics, "fx, fy, cx, cy"),
    ],
)
def test_a_wrong_view_is_refused(voxels: VoxelMap, wrong: dict, error: type, says: str) -> None:
    before = everything(voxels)
    arguments = GOOD | wrong
    with pytest.raises(error, match=says):
        voxels.fuse_depth(**arguments)
    rest = {"scale_m": arguments.pop("depth_scale_m", 0.001)}
    rest["max_range_m"] = arguments.pop("max_range_m", 10.0)
    good = View(**GOOD, scale_m=0.001, max_range_m=10.0)
    with pytest.raises(error, match=says):
        voxels.fuse_many([good, View(**arguments, **rest)])
    assert everything(voxels) == before


@pytest.mark.parametrize(
    ("do", "error", "says"),
    [
        (lambda m: m.fuse_points(np.zeros((3, 2)), (0, 0, 0)), BadPoints, "shape"),
        (lambda m: m.fuse_points([(0, 0, 0)], (math.nan, 0, 0)), BadPoints, "origin"),
        (lambda m: m.fuse_points("here", (0, 0, 0)), BadPoints, "points must be numbers"),
        (lambda m: m.fuse_points([(0, 0, 0), (0, 0)], (0, 0, 0)), BadPoints, "must be numbers"),
        (lambda m: m.fuse_points([(0, 0, 0)], None), BadPoints, "origin"),
        (lambda m: m.fuse_points([(0, 0, 0)], "here"), BadPoints, "origin must be x, y, z"),
        (lambda m: m.fuse_many([3]), BadDepth, "view 3 must be a View"),
        (lambda m: m.fuse_points([(0, 0, 0)], (1e30, 0, 0)), BadPoints, "origin"),
        (lambda m: m.fuse_points([(0, 0, 0)], (0, 0, 0), -1.0), BadPoints, "range -1.0"),
        (lambda m: m.decay(1.0, 0.0), BadDecay, "half-life 0.0"),
        (lambda m: m.decay(1.0, -1.0), BadDecay, "half-life -1.0"),
        (lambda m: m.decay(1.0, math.nan), BadDecay, "half-life nan"),
        (lambda m: m.decay(math.inf, 1.0), BadDecay, "dt inf"),
        (lambda m: m.decay(1e308, 1.0), BadDecay, r"dt 1e\+308 s must lie in 0 \.\. 1e\+09 s"),
        (lambda m: m.decay(-0.1, 1.0), BadDecay, "dt -0.1"),
        (lambda m: m.changes(511), BadRows, "max_rows 511 must be .* at least 512"),
        (lambda m: m.changes(1e4), BadRows, "max_rows 10000.0"),
        (lambda m: m.move_to((math.nan, 0, 0)), BadBox, "centre"),
        (lambda m: m.move_to((1e30, 0, 0)), BadBox, "centre"),
        (lambda m: m.move_to("there"), BadBox, "centre must be x, y, z"),
        (lambda m: m.move_to(None), BadBox, "centre"),
        (lambda m: m.save("map.unknown"), MapperError, "known"),
        (lambda m: m.save("/nowhere/map.npz"), MapperError, "nowhere"),
        (lambda m: m.classify([(0, 0)]), BadPoints, "shape"),
        (lambda m: m.cast_rays([(0, 0, 0)], [(0, 0)]), BadPoints, "shape"),
        (lambda m: m.distance([(0, 0)]), BadPoints, "shape"),
        (lambda m: m.unknown(((0, 0, 0), (0, 1, 1))), BadBox, "volume"),
        (lambda m: m.unknown("all"), BadBox, "two corners"),
        (lambda m: m.unknown(3), BadBox, "two corners"),
        (lambda m: m.unknown([(0, 0, 0)]), BadBox, "two corners"),
        (lambda m: m.unknown(((0, 0, 0), (1, 1))), BadBox, "two corners"),
    ],
)
def test_any_other_wrong_call_is_refused(voxels: VoxelMap, do, error: type, says: str) -> None:
    before = everything(voxels)
    with pytest.raises(error, match=says):
        do(voxels)
    assert everything(voxels) == before


@pytest.mark.parametrize(
    ("resolution", "low", "high", "error", "says"),
    [
        (0.01, (0, 0, 0), (1, 1, 0), BadBox, "volume on every axis"),
        (0.01, (0, 0, 0), (1, 1, -1), BadBox, "volume on every axis"),
        (0.01, (0, 0, 0), (1, 1, math.inf), BadBox, "finite"),
        (0.0, (0, 0, 0), (1, 1, 1), BadBox, "voxel size 0.0"),
        (None, (0, 0, 0), (1, 1, 1), BadBox, "voxel size None"),
        (0.1, "here", (1, 1, 1), BadBox, "bounds must each be x, y, z"),
        (0.1, None, (1, 1, 1), BadBox, "each must be x, y, z"),
        (
            0.0001,
            (-5, -5, -5),
            (5, 5, 5),
            MapTooLarge,
            r"1e\+15 voxels and up to .* GiB; at most 4",
        ),
        (1e-300, (0, 0, 0), (1, 1, 1), MapTooLarge, "GiB"),
    ],
)
def test_a_box_that_cannot_be_is_refused_with_the_memory_it_needs(
    resolution: float, low, high, error: type, says: str
) -> None:
    with np.errstate(all="ignore"), pytest.raises(error, match=says):
        VoxelMap(resolution, low, high)


def test_a_box_has_a_voxel_however_thin_it_is() -> None:
    assert Box.covering(1.0, (0, 0, 0), (1e-9, 1, 1)).num_bricks == (1, 1, 1)


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (
            "--voxel-size 0.0001 --box-min-m -5 -5 -5 --box-max-m 5 5 5",
            ("1e+15", "GiB; at most 4 GiB"),
        ),
        ("--box-max-m -0.6 1 1", ("volume on every axis",)),
        ("--hit 0.4", ("hit 0.4",)),
        ("--half-life-s 0", ("greater than 0",)),
        ("--files /nowhere", ("/nowhere is no folder",)),
        ("--realtime-deadline-s inf", ("60",)),
    ],
)
def test_a_mapper_that_cannot_be_started_says_why_and_ends(flags: str, says) -> None:
    command = (
        "import sys; from services.launcher.cli import dispatch; sys.exit(dispatch(sys.argv[1:]))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", command, "mapper", *flags.split()],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    text = " ".join((ended.stdout + ended.stderr).replace("│", " ").split())
    assert ended.returncode == 2
    assert "Traceback" not in text
    assert all(part in text for part in says), text
