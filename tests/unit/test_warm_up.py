"""After warming up nothing is compiled, nor loaded: an instant never waits for numba."""

import importlib
import itertools
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import services.kernels
from services.mapper.voxel_map import VoxelMap
from services.mapper.warm_up import warm_up

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parents[2]


def signatures() -> dict[str, int]:
    """Count what every kernel is compiled for."""
    modules = [
        importlib.import_module(f"services.kernels.{module.name}")
        for module in pkgutil.iter_modules(services.kernels.__path__)
    ]
    return {
        f"{module.__name__}.{name}": len(kernel.signatures)
        for module in modules
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher)
    }


def clouds_of_any_size() -> None:
    warm_up()
    ready = signatures()
    room = VoxelMap(0.05, (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    rng = np.random.default_rng(0)
    for size, discretize in itertools.product((5000, 3, 700, 0, 9000), (True, False)):
        points = rng.uniform(-2.0, 2.0, (size, 3)).astype(np.float32)
        points[::7] = np.nan
        room.fuse_points(points, (0.0, 0.0, 0.1), 3.0, discretize)
    assert signatures() == ready


def depth_images_of_any_size() -> None:
    warm_up()
    ready = signatures()
    room = VoxelMap(0.02, (-0.5, -0.5, 0.0), (0.5, 0.5, 1.2), dynamic=True)
    rng = np.random.default_rng(0)
    for width, height in ((160, 120), (640, 480), (33, 17)):
        depth = rng.integers(0, 1500, (height, width)).astype(np.uint16)
        camera = (width, width, width / 2, height / 2)
        room.fuse_depth(depth, camera, np.eye(4))
        room.changes()
        room.counts()
        room.decay(0.1, 1.0)
    room.classify(rng.uniform(-1, 1, (50, 3)))
    assert signatures() == ready


@pytest.mark.parametrize("what", [clouds_of_any_size, depth_images_of_any_size])
def test_all_kernels_are_ready(what: Callable[[], None]) -> None:
    """In a process of its own: what other tests have compiled must not help."""
    code = f"from tests.unit.test_warm_up import {what.__name__}; {what.__name__}()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
