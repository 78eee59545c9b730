"""Debian's octomap-tools read our files: `apt-get install octomap-tools`."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from services.mapper import formats
from services.mapper.box import Box
from services.mapper.stored_map import StoredMap, num_known
from tests.octree_reference import random_map

pytestmark = [
    pytest.mark.unit,
    pytest.mark.skipif(
        shutil.which("convert_octree") is None,
        reason="octomap-tools are not installed: apt-get install octomap-tools",
    ),
]


@pytest.fixture(params=[False, True], ids=["plain", "colored"])
def stored(request) -> StoredMap:
    return random_map(np.random.default_rng(3), Box(0.05, (-13, 5, -3), (3, 3, 2)), request.param)


@pytest.fixture
def folder(stored: StoredMap, tmp_path: Path) -> Path:
    formats.write(stored, tmp_path / "ours.bt")
    formats.write(stored, tmp_path / "ours.ot")
    return tmp_path


def run(folder: Path, *command: str) -> str:
    """Run a tool and return what it says; it must end well."""
    done = subprocess.run(
        command, cwd=folder, text=True, capture_output=True, timeout=60, check=True
    )
    assert "ERROR" not in done.stderr
    return done.stdout


def test_convert_octree_copies_our_ot_to_the_last_bit(folder: Path) -> None:
    run(folder, "convert_octree", "ours.ot", "theirs.ot")
    assert (folder / "theirs.ot").read_bytes() == (folder / "ours.ot").read_bytes()


def test_convert_octree_makes_our_bt_of_our_ot(folder: Path, stored: StoredMap) -> None:
    run(folder, "convert_octree", "ours.ot", "theirs.bt")
    ours, theirs = ((folder / name).read_bytes() for name in ("ours.bt", "theirs.bt"))
    kind = b"\nid OcTree\n" if stored.color is None else b"\nid ColorOcTree\n"
    assert theirs == ours.replace(b"\nid OcTree\n", kind)


def test_convert_octree_makes_of_our_bt_what_we_read_in_it(folder: Path) -> None:
    run(folder, "convert_octree", "ours.bt", "theirs.ot")
    formats.write(formats.read(folder / "theirs.ot"), folder / "again.bt")
    assert (folder / "again.bt").read_bytes() == (folder / "ours.bt").read_bytes()


@pytest.mark.parametrize("stored", [False], indirect=True)  # it reads no colors.
def test_compare_octrees_counts_our_voxels_and_finds_no_difference(
    folder: Path, stored: StoredMap
) -> None:
    formats.write(formats.read(folder / "ours.ot"), folder / "again.ot")
    said = run(folder, "compare_octrees", "ours.ot", "again.ot")
    assert f"Expanded num. leafs: {sum(num_known(stored))}\n" in said
    assert re.search(r"^KLD: 0$", said, re.MULTILINE)


def test_bt2vrml_finds_our_occupied_space(folder: Path, stored: StoredMap) -> None:
    run(folder, "bt2vrml", "ours.bt")
    text = (folder / "ours.bt.wrl").read_text()
    edges_m = np.array([float(edge) for edge in re.findall(r"size ([\d.]+) ", text)])
    assert (edges_m**3).sum() == pytest.approx(num_known(stored)[1] * 0.05**3, rel=1e-6)
