"""`encircle convert`, as it is typed."""

import re
from pathlib import Path

import numpy as np
import pytest

from services.launcher.cli import dispatch
from services.launcher.settings import MAP_SUFFIXES
from services.mapper import formats
from services.mapper.voxel_map import VoxelMap
from tests.octree_reference import voxels_of

pytestmark = pytest.mark.unit


@pytest.fixture
def source(tmp_path: Path) -> Path:
    voxels = VoxelMap(0.02, (-0.3, -0.3, -0.1), (0.3, 0.3, 0.3))
    angle = np.linspace(0, 2 * np.pi, 400)
    ring = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), 0 * angle + 0.1], axis=1)
    voxels.fuse_points(ring, (0.0, 0.0, 0.1))
    voxels.save(tmp_path / "map.npz")
    return tmp_path / "map.npz"


def test_a_run_can_save_what_the_mapper_can_write() -> None:
    assert MAP_SUFFIXES == formats.WRITTEN


@pytest.mark.parametrize("name", ["a.npz", "a.bt", "a.ot", "a.ply", "a.obj", "a.glb"])
def test_a_map_is_converted_and_one_line_says_so(name: str, source: Path, capsys) -> None:
    target = source.with_name(name)
    assert dispatch(["convert", str(source), str(target)]) == 0
    stored = formats.read(source)
    occupied = (stored.log_odds >= 0).sum()
    free = ((stored.log_odds < 0) & (stored.log_odds > -32768)).sum()
    out = capsys.readouterr().out
    assert re.fullmatch(
        rf"{source}: {occupied} occupied and {free} free voxels of 0\.02 m, "
        rf"{source.stat().st_size} bytes -> {target}: {target.stat().st_size} bytes\n",
        out,
    )


def test_a_chain_of_lossless_conversions_ends_where_it_began(source: Path) -> None:
    a, b = source.with_name("a.ot"), source.with_name("b.npz")
    assert dispatch(["convert", str(source), str(a)]) == dispatch(["convert", str(a), str(b)]) == 0
    assert voxels_of(formats.read(b)) == voxels_of(formats.read(source))


def test_a_ply_is_points_or_with_mesh_the_surface(source: Path) -> None:
    target = source.with_suffix(".ply")
    assert dispatch(["convert", str(source), str(target)]) == 0
    assert b"element face" not in target.read_bytes()
    assert dispatch(["convert", "--mesh", str(source), str(target)]) == 0
    assert b"element face" in target.read_bytes()


def test_points_become_an_octree_of_the_voxels_asked_for(source: Path) -> None:
    points, tree = source.with_suffix(".ply"), source.with_suffix(".bt")
    points.write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0.51 0.51 0.51\n"
    )
    assert dispatch(["convert", str(points), str(tree), "--voxel", "0.25"]) == 0
    assert formats.read(tree).box.resolution_m == 0.25
    assert list(voxels_of(formats.read(tree))) == [(32770, 32770, 32770)]


@pytest.mark.parametrize(
    ("args", "code", "says"),
    [
        (["map.npz", "a.xyz"], 2, r"unknown format '\.xyz' of .*; known: \.npz, \.ply, \.bt"),
        (["map.xyz", "a.bt"], 2, r"unknown format '\.xyz'"),
        (["map.glb", "a.bt"], 2, "map.glb is a surface, not a map; known: .npz, .ply, .bt, .ot"),
        (["map.npz", "a.bt", "--mesh"], 2, r"unknown mesh format '\.bt'.*; known: \.ply, \.obj"),
        (["map.npz", "a.bt", "--voxel", "0.1"], 2, r"--voxel is for points \(\.ply\)"),
        (["map.ply", "a.bt", "--voxel", "nan"], 2, "--voxel nan must be positive"),
        (["map.ply", "a.bt", "--voxel", "0"], 2, "--voxel 0.0 must be positive"),
        (["none.bt", "a.npz"], 1, "cannot read .*none.bt: No such file"),
        (["bad.npz", "a.bt"], 1, "cannot read .*bad.npz: no map of ours"),
        (["map.npz", "none/a.bt"], 1, "cannot write .*a.bt: No such file or directory"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    args: list[str], code: int, says: str, source: Path, capsys
) -> None:
    source.with_name("bad.npz").write_bytes(b"PK\x03\x04")
    folder = source.parent
    paths = [str(folder / arg) if "." in arg and not arg[0].isdigit() else arg for arg in args]
    before = sorted(folder.rglob("*"))
    assert dispatch(["convert", *paths]) == code
    error = capsys.readouterr().err
    assert re.fullmatch(rf"encircle convert: .*{says}.*\n", error)
    assert sorted(folder.rglob("*")) == before


def test_wrong_flags_end_with_the_usage(capsys) -> None:
    with pytest.raises(SystemExit) as end:
        dispatch(["convert", "map.npz"])
    assert end.value.code == 2
    assert "usage: encircle convert" in capsys.readouterr().err


def test_help_tells_the_formats(capsys) -> None:
    with pytest.raises(SystemExit) as end:
        dispatch(["convert", "--help"])
    assert end.value.code == 0
    text = capsys.readouterr().out
    for suffix in (".npz", ".ot", ".bt", ".ply", ".obj", ".glb"):
        assert f"  {suffix}" in text or f" {suffix} " in text
