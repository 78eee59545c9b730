"""What may be asked of the formation, and how a wrong request is answered."""

import numpy as np
import pytest

from services.planner.errors import PlannerError, UnknownSettingError
from services.planner.formation import FormationSettings
from services.planner.motion import still
from services.planner.strategies.circle import Circle
from services.planner.strategies.dome import Dome
from services.planner.strategies.open import open_strategy
from services.planner.strategies.orbit import Orbit
from services.planner.strategies.random import Random
from services.planner.strategies.rings import Rings
from services.planner.strategies.sphere import Sphere
from services.planner.strategies.static import Static

pytestmark = pytest.mark.unit


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("circle", Circle),
        ("rings", Rings),
        ("sphere", Sphere),
        ("orbit", Orbit),
        ("random", Random),
        ("static", Static),
        ("dome", Dome),
    ],
)
def test_each_strategy_opens_with_as_many_views_as_cameras(name, kind):
    strategy = open_strategy(FormationSettings(strategy=name, cameras=5).strategy_settings())
    assert isinstance(strategy, kind)
    assert len(strategy.plan(still(np.eye(4)), 0.0).views) == 5


@pytest.mark.parametrize("name", ["orbit", "random", "dome"])
def test_what_needs_wings_is_refused_to_wheels_with_the_choices(name):
    with pytest.raises(PlannerError, match=f"drive unicycle with strategy {name}.* known: circle"):
        FormationSettings(strategy=name).changed({"drive": "unicycle"})


def test_a_change_keeps_the_rest():
    before = FormationSettings(cameras=3, radius_m=2.0)
    after = before.changed({"elevation_deg": 30})
    assert after == FormationSettings(cameras=3, radius_m=2.0, elevation_deg=30)


def test_an_unknown_setting_is_answered_with_the_known_ones():
    with pytest.raises(
        UnknownSettingError, match="no setting radius; known: strategy, cameras, radius"
    ):
        FormationSettings().changed({"radius": 1})


@pytest.mark.parametrize(
    ("params", "complaint"),
    [
        ({"cameras": 65}, "cameras = 65: .*less than or equal to 64"),
        ({"radius_m": -1}, "radius_m = -1: .*greater than 0"),
        ({"strategy": "cube"}, "strategy = 'cube': .*'circle', .*'static' or 'dome'"),
        ({"elevation_deg": -60}, "elevation_deg -60 at radius_m 1.1 .* below the ground"),
        ({"radius_m": float("nan")}, "radius_m = nan"),
    ],
)
def test_a_bad_value_is_answered_with_value_and_rule(params, complaint):
    with pytest.raises(PlannerError, match=complaint):
        FormationSettings().changed(params)
