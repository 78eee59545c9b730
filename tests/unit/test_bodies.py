"""pybullet sees who touches whom."""

import pytest

from services.kernels.rigid import look_at, planar
from services.simulator.bodies import CAMERA_RADIUS_M, Bodies, Encounter, hull_corners
from services.simulator.proximity import Proximity
from services.world.mesh import load_mesh

pytestmark = pytest.mark.unit

SPHERE = hull_corners(load_mesh("sphere", 0.4).vertices_m)


def at(x, y, z):
    return look_at([x, y, z], [x, y + 1.0, z])


def test_cameras_apart_meet_nobody():
    with Bodies(SPHERE) as bodies:
        bodies.place(planar(0, 0, 0), {0: at(1, 0, 0.5), 1: at(-1, 0, 0.5)})
        assert bodies.encounters([0, 1], 0.1) == []


@pytest.mark.parametrize("gap_m", [-0.02, 0.01, 0.04])
def test_the_distance_to_ground_target_and_camera_is_measured(gap_m):
    r = CAMERA_RADIUS_M
    poses = {
        0: at(3, 0, r + gap_m),  # over the ground.
        1: at(1.2 + r + gap_m, 2.0, 0.2),  # beside the sphere at (1, 2).
        2: at(5, 0, 0.5),
        3: at(5, 2 * r + gap_m, 0.5),  # beside camera 2.
    }
    with Bodies(SPHERE) as bodies:
        bodies.place(planar(1.0, 2.0, 0.7), poses)
        found = {(e.one, e.other): e.distance_m for e in bodies.encounters([0, 1, 2, 3], 0.05)}
    assert set(found) == {
        ("camera/0", "ground"),
        ("camera/1", "target"),
        ("camera/2", "camera/3"),
    }
    assert found["camera/0", "ground"] == pytest.approx(gap_m, abs=1e-3)
    assert found["camera/1", "target"] == pytest.approx(gap_m, abs=0.01)  # a hull of a few points.
    assert found["camera/2", "camera/3"] == pytest.approx(gap_m, abs=1e-3)


def test_an_encounter_is_counted_when_it_begins_and_again_when_it_comes_back():
    proximity = Proximity()
    near, touching = Encounter("camera/0", "target", 0.03), Encounter("camera/0", "target", -0.01)
    assert proximity.update([near]) == []
    assert proximity.update([touching]) == [touching]
    assert proximity.update([touching]) == []
    assert (proximity.num_close, proximity.num_contacts) == (1, 1)
    proximity.update([])
    proximity.update([touching])
    assert (proximity.num_close, proximity.num_contacts) == (2, 2)


def test_cameras_come_and_go_and_the_target_changes():
    beside = {0: at(0.2 + CAMERA_RADIUS_M + 0.02, 0, 0.2)}
    with Bodies(SPHERE) as bodies:
        bodies.place(planar(0, 0, 0), beside | {1: at(0.0, 1.0, 0.5)})
        assert [e.other for e in bodies.encounters([0, 1], 0.05)] == ["target"]
        bodies.place(planar(0, 0, 0), beside)  # camera 1 has left.
        bodies.change_target(hull_corners(load_mesh("sphere", 0.1).vertices_m))
        bodies.place(planar(0, 0, 0), beside)
        assert bodies.encounters([0], 0.05) == []
        bodies.place(planar(0, 0, 0), beside | {1: beside[0]})
        assert {(e.one, e.other) for e in bodies.encounters([0, 1], 0.05)} == {
            ("camera/0", "camera/1")
        }
