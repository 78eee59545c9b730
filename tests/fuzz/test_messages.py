"""Mutated messages of every topic against living services, and the services' answer afterwards.

`benchmarks/fuzz.py` sends a million of them.
"""

import logging
import time

import pytest

from schemas.topics import FORMATION, MAP_SUMMARY, QUALITY, TOPICS
from services.runtime.bus import Bus
from services.runtime.router import router
from services.runtime.settings import BusSettings
from tests.fuzz.campaign import SERVICES, good, looking_down, run
from tests.fuzz.mutation import Mutator
from tests.fuzz.victims import victims

pytestmark = pytest.mark.integration

NUM = 100_000
WAIT_S = 10.0
MOST_GROWTH_MIB = 25.0
"""Python's own arenas and viser's history of a page; a leak of 1 kB a message would be 49. It goes
in steps of up to 16 MiB, when a rare message makes something work for the first time."""


def everything_goes_on(victims, endpoint, boot):
    """Each service answers what is right, rightly."""

    def hear(name):
        return Bus(BusSettings(connect=endpoint, namespace=name), "inspector")

    target = {"tick": 1000, "boot": boot}
    mapper = victims["mapper"]
    with hear("mapper") as bus, bus.every(MAP_SUMMARY) as told:
        until(lambda: mapper.bus.matching(MAP_SUMMARY))
        # A new run: time goes back, for the camera as for the target.
        assert mapper.send("target/pose", good("target_pose", **target, frame_id="world"))
        assert mapper.send("cams/3/cloud", looking_down())
        summary = hear_next(mapper, told)
        while summary.tick != 1000:
            summary = hear_next(mapper, told)
        assert summary.cameras_used == (3,)
        assert summary.num_returns == 48 * 64

    planner = victims["planner"]
    with hear("planner") as bus, bus.every(FORMATION) as told:
        until(lambda: planner.bus.matching(FORMATION))
        assert planner.send("target/pose", good("target_pose", **target))
        formation = hear_next(planner, told)
        assert formation.tick == 1000
        assert 3 in [each.camera for each in formation.references]

    evaluator = victims["evaluator"]
    with hear("evaluator") as bus, bus.every(QUALITY) as told:
        until(lambda: evaluator.bus.matching(QUALITY))
        assert evaluator.send("sim/state", good("sim_state", **target))
        assert evaluator.send("cams/3/info", good("camera_info", **target))
        assert evaluator.send("map/changes", good("map_changes", **target, base_rev=0, rev=1))
        used = {"cameras_used": (3,), "cameras_missing": (), "rev": 1}
        assert evaluator.send("map/summary", good("map_summary", **target, **used))
        quality = hear_next(evaluator, told)
        assert (quality.tick, quality.rev, quality.num_samples) == (1000, 1, 1000)

    viewer = victims["viewer"]
    assert viewer.send("map/changes", good("map_changes", **target, base_rev=0, rev=1))
    frames = viewer.service._get({})["frames"]
    until(lambda: viewer.settle() or viewer.service._get({})["frames"] > frames)
    assert viewer.service._get({})["voxels"] == 1


def hear_next(victim, told):
    """Drive a service until it says something."""
    deadline_s = time.monotonic() + WAIT_S
    while True:
        victim.settle()
        try:
            return told.get(0.02).message
        except TimeoutError:
            assert time.monotonic() < deadline_s, f"{victim.name} is silent"


def until(happens):
    deadline_s = time.monotonic() + WAIT_S
    while not happens():
        assert time.monotonic() < deadline_s


@pytest.fixture
def quiet():
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


@pytest.mark.usefixtures("quiet")
def test_a_few_mutants_leave_every_service_well():
    with router() as endpoint, victims(endpoint, SERVICES) as living:
        everything_goes_on(living, endpoint, "before")
        outcome = run(living, 2000, 0, lambda _: None)
        assert outcome.num_sent > 2000
        assert outcome.num_bad > 1000
        everything_goes_on(living, endpoint, "after")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.usefixtures("quiet")
def test_many_mutants_are_counted_and_leave_no_trace():
    with router() as endpoint, victims(endpoint, SERVICES) as living:
        outcome = run(living, NUM, 1, print)
        assert outcome.num_sent == NUM
        assert outcome.growth_mib < MOST_GROWTH_MIB
        everything_goes_on(living, endpoint, "after")


def test_every_topic_that_is_listened_to_has_a_seed():
    """Else a new topic would never be attacked."""
    from tests.examples import EXAMPLES

    assert {topic.key for topic, _ in EXAMPLES.values()} == {topic.key for topic in TOPICS}


def test_a_mutant_is_made_again_from_its_seed():
    payload = good("map_changes", 1, "a")
    first, second = Mutator(5), Mutator(5)
    for _ in range(200):
        assert first.mutant(payload) == second.mutant(payload)
