"""Runs every mapper on one scene, each in a process of its own, one thread each."""

import json
import os
import shutil
import struct
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.mapping_rivals import RIVALS
from benchmarks.mapping_scenes import Scene
from services.mapper.box import Box

HERE = Path(__file__).parent
ONE_THREAD = {
    name: "1"
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "TBB_NUM_THREADS")
}
CPP = {
    "OctoMap C++, discretised": (1, 0),
    "OctoMap C++, discretised, lazy": (1, 1),
    "OctoMap C++, ray per point": (0, 0),
}
"""OctoMap without a binding: discretize, lazy_eval."""


@dataclass(frozen=True)
class Measured:
    """What one mapper needed."""

    ms: NDArray[np.float64]
    """(rounds, images) CPU time."""
    nodes_bytes: int
    """What the map says it holds."""
    steady_bytes: int
    """Growth of the process by the map, after the last image."""
    peak_bytes: int
    """The same at its highest."""
    classes: NDArray[np.uint8] | None
    """(nx, ny, nz) of the scene's box, or None if it does not say."""

    def round_ms(self, n: int) -> float:
        """Return the median over the images of the n-th round, from 1; NaN if it was not run."""
        return float(np.median(self.ms[n - 1])) if n <= len(self.ms) else float("nan")


class Race:
    """One scene at one voxel size, written down once for all mappers."""

    def __init__(self, scene: Scene, voxel_m: float, folder: Path) -> None:
        self.voxel_m, self.box = voxel_m, Box.covering(voxel_m, *scene.box)
        self._folder, self._scene = folder, folder / "scene.npz"
        self._clouds = folder / "clouds.bin"
        scene.write(self._scene)
        with self._clouds.open("wb") as file:
            for cloud, eye in scene.clouds():
                file.write(struct.pack("q3d", len(cloud), *eye))
                file.write(cloud.astype(np.float32).tobytes())

    def run(self, name: str, rounds: int) -> Measured | str:
        """Measure one mapper; a text says why it is absent."""
        classes = self._folder / "classes.npy"
        classes.unlink(missing_ok=True)
        if name in CPP:
            program = compiled(self._folder.parent)
            if isinstance(program, str):
                return program
            command = [program, self._clouds, self.voxel_m, rounds, *CPP[name], classes]
            command += [*self.box.first_key, *self.box.shape]
        else:
            command = [sys.executable, HERE / "mapping_run.py", name, self._scene]
            command += [self.voxel_m, rounds, classes]
        done = subprocess.run(
            [str(part) for part in command],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | ONE_THREAD,
        )
        if done.returncode:
            return f"failed: {done.stderr.strip().splitlines()[-1:]}"
        answer = json.loads(done.stdout.splitlines()[-1])
        if "absent" in answer:
            return str(answer["absent"])
        return Measured(
            np.array(answer["ms"]),
            answer["nodes_bytes"],
            answer["steady_kib"] * 1024,
            answer["peak_kib"] * 1024,
            self._read(classes),
        )

    def _read(self, path: Path) -> NDArray[np.uint8] | None:
        if not path.exists():
            return None
        if path.read_bytes()[:6] == b"\x93NUMPY":
            return np.asarray(np.load(path))
        return np.fromfile(path, np.uint8).reshape(self.box.shape)


def compiled(folder: Path) -> Path | str:
    """Return the program around OctoMap's library, built if need be, or why there is none."""
    program, compiler = folder / "mapping_octomap", shutil.which("g++")
    if program.exists():
        return program
    if compiler is None:
        return "no g++ (apt-get install g++ liboctomap-dev)"
    source = HERE / "mapping_octomap.cpp"
    flags = ["-O3", "-march=native", "-loctomap", "-loctomath"]
    built = subprocess.run(
        [compiler, str(source), "-o", str(program), *flags],
        capture_output=True,
        text=True,
        check=False,
    )
    return program if built.returncode == 0 else "no liboctomap-dev (apt-get install it)"


ALL = (*RIVALS, *CPP)
