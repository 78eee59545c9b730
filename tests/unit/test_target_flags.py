"""`encircle run` and the target that is not given."""

import pytest
from pydantic import ValidationError

from services.launcher.processes import process_table
from services.launcher.settings import RunSettings
from services.mapper.settings import MapperSettings
from services.planner.settings import PlannerSettings
from services.runtime.service import parse
from services.simulator.settings import SimulatorSettings

pytestmark = pytest.mark.unit

TYPES = {"simulator": SimulatorSettings, "planner": PlannerSettings, "mapper": MapperSettings}


def told(name, **flags):
    """Return the settings that a service of the run arrives at."""
    specs = process_table(RunSettings(**flags), "tcp/127.0.0.1:7999")
    argv = next(spec.argv for spec in specs if spec.name == name)
    return parse(TYPES[name], name, argv[3:])


def test_the_tracker_is_told_to_the_simulator_and_the_mode_to_the_planner():
    flags = {
        "target": "filtered",
        "target_noise_m": 0.02,
        "target_noise_rad": 0.006,
        "target_delay_s": 0.1,
        "target_dropout": 0.2,
        "seed": 5,
    }
    tracker = told("simulator", **flags).tracker()
    assert (tracker.noise_m, tracker.noise_rad, tracker.dropout) == (0.02, 0.006, 0.2)
    assert (tracker.delay_ns, tracker.seed) == (100_000_000, 5)
    assert told("planner", **flags).target == "filtered"
    assert told("planner").target == "given"


def test_a_target_in_the_map_is_looked_for_in_an_arena_that_follows_nobody():
    flags = {"target": "map", "frame": "world", "height": 0.6, "voxel_size": 0.04}
    mapper, planner = told("mapper", **flags), told("planner", **flags)
    assert (mapper.frame, mapper.follow) == ("world", "none")
    for name in ("ellipse", "circle", "eight"):
        motion = SimulatorSettings(path=name).motion()
        for step in range(200):
            x, y = motion.at(step * motion.period_s / 200).position_m
            assert mapper.box_min_m[0] + 0.6 < x < mapper.box_max_m[0] - 0.6
            assert mapper.box_min_m[1] + 0.6 < y < mapper.box_max_m[1] - 0.6
    assert planner.ground_m == 0.08
    assert planner.reach_m == 1.2


@pytest.mark.parametrize(
    ("flags", "rule"),
    [
        ({"target": "map"}, "target map with frame target"),
        ({"target": "map", "frame": "world", "follow": "target"}, "nobody is to know"),
        ({"target_noise_m": 0.02}, "nobody listens to the tracker; choose target filtered"),
        (
            {"target": "map", "frame": "world", "target_delay_s": 0.1},
            "target_delay_s 0.1 with target map",
        ),
        (
            {"target": "map", "frame": "world", "path": "line"},
            "after 30.2 s the object leaves the arena .* choose --arena -0.5 -0.5 3.7 0.5 or more",
        ),
        (
            {"target": "map", "frame": "world", "semi_axes": (3.0, 1.2)},
            "leaves the arena .* choose --arena -3.5 -0.5 3.5 2.9 or more",
        ),
        (
            {
                "target": "map",
                "frame": "world",
                "path": "line",
                "forever": True,
                "arena": (-9, -9, 9, 9),
            },
            "no arena is long enough",
        ),
        ({"arena": (1.0, 0.0, 0.0, 1.0)}, "each least must be below its greatest"),
        ({"target": "filtered", "target_dropout": 1.5}, "less than or equal to 1"),
    ],
)
def test_what_cannot_work_is_refused_with_its_rule(flags, rule):
    with pytest.raises(ValidationError, match=rule):
        RunSettings(**flags)


def test_a_line_is_driven_in_an_arena_that_is_long_enough_or_for_a_shorter_time():
    RunSettings(target="map", frame="world", path="line", arena=(-0.5, -0.5, 3.7, 0.5))
    RunSettings(target="map", frame="world", path="line", duration=25.0)
