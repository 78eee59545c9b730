"""Another object is told to those who cannot see it, however long that takes."""

import pytest

from schemas.sim import SceneSpec
from services.launcher.scenery import Scenery
from services.runtime.errors import CommandFailed, NoReply

pytestmark = pytest.mark.unit

BUNNY = SceneSpec(object="bunny", height_m=0.4, subdivide=0, deformations=(), seed=0)
BOX = BUNNY.model_copy(update={"object": "box", "height_m": 0.3})
RESET = ("mapper", "reset", {})
RAISE = ("planner", "set", {"centre_height_m": 0.15})


class Told:
    """Takes requests, except of those who are away."""

    def __init__(self):
        self.away, self.told = {}, []

    def __call__(self, service, verb, params):
        if service in self.away:
            raise self.away[service]
        self.told.append((service, verb, params))


def test_each_is_told_of_another_object_once():
    told = Told()
    scenery = Scenery(told)
    for scene in (BUNNY, BUNNY, BOX, BOX):
        scenery.update(scene)
    assert told.told == [RESET, RAISE]


@pytest.mark.parametrize("error", [NoReply("nobody"), CommandFailed("busy")])
@pytest.mark.parametrize("service", ["mapper", "planner"])
def test_who_is_away_is_told_later_and_the_other_at_once(service, error):
    told = Told()
    scenery = Scenery(told)
    told.away = {service: error}
    for scene in (BUNNY, BOX, BOX):
        scenery.update(scene)
    (other,) = (each for each in (RESET, RAISE) if each[0] != service)
    assert told.told == [other]
    told.away = {}
    scenery.update(BOX)
    scenery.update(BOX)
    assert sorted(told.told, key=str) == sorted([RESET, RAISE], key=str)
