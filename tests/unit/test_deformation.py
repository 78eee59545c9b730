"""Deformations: the kernel, its laws, and how they are written down."""

import math

import numpy as np
import pytest
import trimesh

from schemas.sim import DeformationSpec
from services.kernels import deform as kernel
from services.world.deformation import KINDS, check, deformed, parse_deformations
from services.world.errors import DeformationError
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

BODY = load_mesh("bunny", 0.4, subdivide=2)
TIMES = np.linspace(0.1, 9.7, 9)


def twin(rest, height, kinds, amplitudes, angles):
    """Deform in numpy, formula by formula."""
    x, y, z = (rest[:, i].astype(np.float64) for i in range(3))
    q = z / height
    for kind, amplitude, angle in zip(kinds, amplitudes, angles, strict=True):
        s = amplitude * np.sin(angle)
        match kind:
            case kernel.BREATHING:
                x, y = x * (1 + 4 * s * q * (1 - q)), y * (1 + 4 * s * q * (1 - q))
            case kernel.SQUASH:
                x, y, z = x / np.sqrt(1 + s), y / np.sqrt(1 + s), z * (1 + s)
            case kernel.BEND:
                x = x + s * height * q**2 / 2
            case kernel.TWIST:
                turned = (x + 1j * y) * np.exp(1j * s * q)
                x, y = turned.real, turned.imag
            case kernel.WAVE:
                swell = 1 + amplitude * q * (2 - q) * np.sin(4 * np.pi * q - angle)
                x, y = x * swell, y * swell
    return np.stack([x, y, z], axis=1)


@pytest.mark.parametrize("seed", range(10))
def test_the_kernel_computes_what_its_numpy_twin_does(seed):
    rng = np.random.default_rng(seed)
    kinds = rng.integers(0, 5, rng.integers(1, 6))
    amplitudes, angles = rng.uniform(0, 0.6, len(kinds)), rng.uniform(-9, 9, len(kinds))
    out = np.empty_like(BODY.vertices_m)
    kernel.deform(out, BODY.vertices_m, 0.4, kinds, amplitudes, angles)
    expected = twin(BODY.vertices_m, 0.4, kinds, amplitudes, angles)
    np.testing.assert_allclose(out, expected, atol=1e-6)


@pytest.mark.parametrize("kind", [*KINDS, "+".join(KINDS)])
def test_the_feet_stay_on_the_ground_and_nothing_goes_below(kind):
    specs = parse_deformations(kind)
    feet = BODY.vertices_m[:, 2] == 0.0
    assert feet.any()
    for t in TIMES:
        vertices = deformed(BODY.vertices_m, 0.4, specs, t)
        assert np.isfinite(vertices).all()
        assert vertices[:, 2].min() == 0.0
        assert (vertices[feet, 2] == 0.0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_moves_the_body_and_leaves_it_a_closed_solid(kind):
    specs = parse_deformations(kind)
    before = trimesh.Trimesh(BODY.vertices_m, BODY.faces, process=False).volume
    moves = []
    for t in TIMES:
        vertices = deformed(BODY.vertices_m, 0.4, specs, t)
        after = trimesh.Trimesh(vertices, BODY.faces, process=False)
        assert after.is_volume
        assert after.volume > 0.5 * before
        moves.append(np.linalg.norm(vertices - BODY.vertices_m, axis=1).max())
    assert max(moves) > 0.01  # a centimetre: more than a voxel.


@pytest.mark.parametrize("kind", ["squash", "bend", "twist"])
def test_squash_bend_and_twist_keep_the_volume(kind):
    before = trimesh.Trimesh(BODY.vertices_m, BODY.faces, process=False).volume
    for t in TIMES:
        vertices = deformed(BODY.vertices_m, 0.4, parse_deformations(kind), t)
        after = trimesh.Trimesh(vertices, BODY.faces, process=False).volume
        assert after == pytest.approx(before, rel=2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_field_comes_back_after_its_period(kind):
    (spec,) = parse_deformations(kind)
    a, b = (deformed(BODY.vertices_m, 0.4, [spec], t) for t in (0.7, 0.7 + 1 / spec.hz))
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_phase_shifts_time():
    late = DeformationSpec(kind="bend", amplitude=0.4, hz=0.5, phase_rad=math.pi / 2)
    now = DeformationSpec(kind="bend", amplitude=0.4, hz=0.5)
    a = deformed(BODY.vertices_m, 0.4, [late], 1.0)
    np.testing.assert_allclose(a, deformed(BODY.vertices_m, 0.4, [now], 1.5), atol=1e-6)


@pytest.mark.parametrize("text", ["", "rigid", " rigid "])
def test_a_rigid_body_has_no_deformations_and_is_not_copied(text):
    assert parse_deformations(text) == ()
    assert deformed(BODY.vertices_m, 0.4, (), 3.0) is BODY.vertices_m


def test_a_sum_with_numbers_is_read_in_order():
    specs = parse_deformations("bend:0.3:0.5 + twist:0.2:1:1.5 + breathing")
    assert [s.kind for s in specs] == ["bend", "twist", "breathing"]
    assert (specs[0].amplitude, specs[0].hz, specs[0].phase_rad) == (0.3, 0.5, 0.0)
    assert (specs[1].amplitude, specs[1].hz, specs[1].phase_rad) == (0.2, 1.0, 1.5)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("melt", "'melt'; known: rigid, breathing"),
        ("bend+", "''; known"),
        ("bend:much", "could not convert"),
        ("bend:0.1:0.2:0.3:0.4", "joined by"),
        ("bend:nan", "amplitude"),
        ("bend:-0.1", "amplitude"),
        ("bend:0.1:1e9", "hz"),
        ("squash:1.0", r"squash amplitude must be 0..0.8, got 1.0"),
    ],
)
def test_a_bad_deformation_is_refused_with_the_rule(text, rule):
    with pytest.raises(DeformationError, match=rule):
        parse_deformations(text)


def test_an_amplitude_from_elsewhere_is_checked_too():
    with pytest.raises(DeformationError, match="wave"):
        check([DeformationSpec(kind="wave", amplitude=1.5, hz=1.0)])
