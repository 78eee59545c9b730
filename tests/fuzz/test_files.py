"""Files that are damaged, cut short or made up: our own clear error, soon, and within bounds."""

import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.launcher.errors import SettingsError
from services.launcher.layers import scenario_layer, settle
from services.mapper import formats
from services.mapper.errors import MapperError
from services.mapper.voxel_map import VoxelMap
from services.planner.errors import ViewFileError
from services.planner.view_file import format_views, read_views
from services.recorder.errors import RecorderError
from services.recorder.log_file import RecordedLog
from services.world import mesh_file
from services.world.errors import MeshError
from services.world.mesh import load_mesh
from tests.small_recording import SmallRecording

pytestmark = pytest.mark.integration

NUM = 60
"""Mutants of each kind of file."""
LONGEST_S = 10.0
MOST_MIB = 1024.0
ROOT = Path(__file__).parents[2]


class Kind(NamedTuple):
    """A kind of file: how one is made, read, and refused."""

    suffix: str
    make: Callable[[Path], object]
    read: Callable[[Path], object]
    error: type[Exception]


def a_map() -> VoxelMap:
    made = VoxelMap(0.05, (-0.4, -0.4, 0.0), (0.4, 0.4, 0.4))
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 0.8
    made.fuse_depth(np.full((24, 32), 700, np.uint16), (30.0, 30.0, 15.5, 11.5), T)
    return made


def write_mesh(path: Path) -> None:
    import trimesh

    body = load_mesh("box", 0.4, 0)
    trimesh.Trimesh(body.vertices_m, body.faces).export(path)


def read_log(path: Path) -> None:
    with RecordedLog(path) as log:
        assert log.metadata is not None
        for _ in log.channels, log.start_ns, log.end_ns, len(log), *log:
            pass


def write_scenario(path: Path) -> None:
    path.write_text((ROOT / "scenarios" / "deforming.toml").read_text())


def read_map(path: Path) -> None:
    VoxelMap.load(path)


KINDS = {
    **{
        suffix: Kind(suffix, lambda path: a_map().save(path), read_map, MapperError)
        for suffix in (".npz", ".bt", ".ot", ".ply")
    },
    **{
        f"mesh{suffix}": Kind(suffix, write_mesh, mesh_file.read, MeshError)
        for suffix in mesh_file.SUFFIXES
    },
    "recording": Kind(".mcap", lambda path: SmallRecording(path, 3), read_log, RecorderError),
    "scenario": Kind(
        ".toml", write_scenario, lambda path: settle([scenario_layer(path)]), SettingsError
    ),
    "views": Kind(
        ".txt",
        lambda path: path.write_text(format_views([np.eye(4)] * 5)),
        read_views,
        ViewFileError,
    ),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, bytes]:
    """A good file of each kind."""
    folder, made = tmp_path_factory.mktemp("whole"), {}
    for name, kind in KINDS.items():
        path = folder / f"whole{kind.suffix}"
        kind.make(path)
        made[name] = path.read_bytes()
        path.unlink()
    return made


def mutants(data: bytes, num: int, seed: int) -> Iterator[bytes]:
    """Yield damaged copies."""
    rng = np.random.default_rng(seed)
    for number in range(num):
        changed = bytearray(data)
        at = int(rng.integers(len(data)))
        match number % 6:
            case 0:
                del changed[at:]
            case 1:
                for _ in range(int(rng.integers(1, 8))):
                    changed[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
            case 2:
                changed[at : at + 8] = b"\xff" * 8
            case 3:
                del changed[at : at + int(rng.integers(1, 64))]
            case 4:
                changed[at:at] = rng.bytes(int(rng.integers(1, 64)))
            case _:
                # What is written in digits is made great, small, negative.
                digits = [i for i, byte in enumerate(data) if 48 <= byte <= 57]
                if digits:
                    place = digits[int(rng.integers(len(digits)))]
                    words = (
                        b"-",
                        b"9" * 18,
                        b"1e400",
                        b"nan",
                        b"inf",
                        b"1152921504606846976",
                        b"0",
                    )
                    changed[place : place + 1] = words[int(rng.integers(len(words)))]
        yield bytes(changed)


def read_or_refuse(kind: Kind, path: Path, data: bytes) -> bool:
    """Return whether the data were taken; anything but our own error fails."""
    path.write_bytes(data)
    began_s = time.monotonic()
    try:
        kind.read(path)
        told = None
    except kind.error as error:
        told = str(error)
    finally:
        took_s = time.monotonic() - began_s
        assert took_s < LONGEST_S, f"{took_s:.1f} s for {data[:200]!r}"
    assert told is None or 0 < len(told) < 20_000
    return told is None


def peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_are_read_or_refused_and_nothing_else(name, whole, tmp_path) -> None:
    kind = KINDS[name]
    path = tmp_path / f"damaged{kind.suffix}"
    assert read_or_refuse(kind, path, whole[name])
    before = peak_mib()
    taken = [read_or_refuse(kind, path, each) for each in mutants(whole[name], NUM, 0)]
    if name != "recording":  # What is readable of a damaged one is read; it says what is lost.
        assert not all(taken)
    assert peak_mib() - before < MOST_MIB


@pytest.mark.parametrize("name", KINDS)
@settings(
    max_examples=40, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(data=st.data())
def test_made_up_files_are_refused(name, whole, tmp_path, data) -> None:
    """Random bytes, behind as much of a good file's beginning as makes them look right."""
    kind = KINDS[name]
    begin = data.draw(st.sampled_from([0, 4, 16, 64, 256, len(whole[name]) // 2]))
    made = whole[name][:begin] + data.draw(st.binary(max_size=512))
    read_or_refuse(kind, tmp_path / f"made{kind.suffix}", made)


HUGE = 2**60


@pytest.mark.parametrize(
    ("name", "data"),
    [
        (".bt", b"# Octomap OcTree binary file\nid OcTree\nsize %d\nres 1e-9\ndata\n\x02\x00"),
        (".ot", b"# Octomap OcTree file\nid OcTree\nsize %d\nres 0.1\ndata\n" + b"\x00" * 5),
        (".ply", b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
                 b"property float y\nproperty float z\nend_header\n"),
        (".ply", b"ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\n"
                 b"property float y\nproperty float z\nend_header\n1 2 3\n"),
        ("mesh.ply", b"ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\n"
                     b"property float y\nproperty float z\nelement face %d\n"
                     b"property list uchar int vertex_indices\nend_header\n0 0 0\n"),
        ("mesh.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
                     b"property float y\nproperty float z\nend_header\n0000"),
        ("mesh.off", b"OFF\n%d %d 0\n0 0 0\n"),
        ("mesh.stl", b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 50),
        ("mesh.obj", b"v 0 0 0\nf 1 2 %d\n"),
        ("views", b"%d\n0 0 0 0 0 0 1\n"),
        ("scenario", b"cameras = %d\n"),
        ("scenario", b"cameras = " + b"9" * 5000),
        ("scenario", b"a = " + b"[" * 5000),
        ("views", b"9" * 5000 + b"\n0 0 0 0 0 0 1\n"),
        (".bt", b"# Octomap OcTree binary file\nid OcTree\nsize "
                + b"9" * 5000 + b"\nres 1\ndata\n"),
        (".ply", b"ply\nformat ascii 1.0\nelement vertex " + b"9" * 5000 + b"\nproperty float x\n"
                 b"property float y\nproperty float z\nend_header\n1 2 3\n"),
    ],
)  # fmt: skip
def test_a_header_that_claims_everything_takes_neither_time_nor_memory(
    name, data, tmp_path
) -> None:
    kind = KINDS[name]
    data = data.replace(b"%d", str(HUGE).encode())
    before = peak_mib()
    assert not read_or_refuse(kind, tmp_path / f"huge{kind.suffix}", data)
    assert peak_mib() - before < 256


def test_an_archive_that_unfolds_to_gigabytes_is_refused_unread(tmp_path) -> None:
    import zipfile

    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("format", "resolution_m", "first_key", "num_bricks", "sensor", "bricks"):
            archive.writestr(f"{name}.npy", b"\0" * 2**26)
    before = peak_mib()
    with pytest.raises(MapperError):
        formats.read(path)
    assert peak_mib() - before < 64
