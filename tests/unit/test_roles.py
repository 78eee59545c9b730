"""Who may say what follows from the topic table; nobody speaks for another."""

import json

import pytest
import zenoh

from schemas.camera import MAX_CAMERAS
from schemas.topics import TOPICS, Delivery
from services.runtime.access import access_control
from services.runtime.roles import COMMANDERS, SINGLES, WITHOUT_TRUTH, role_of, roles

pytestmark = pytest.mark.unit

SAID = [topic for topic in TOPICS if topic.delivery is not Delivery.QUERY]


def speakers(key: str) -> set[str]:
    """Return the roles, without replay, that may say something under a key."""
    wanted = zenoh.KeyExpr(key)
    return {
        role.name
        for role in roles(4)
        if role.name != "replay" and any(zenoh.KeyExpr(say).includes(wanted) for say in role.says)
    }


@pytest.mark.parametrize("topic", SAID, ids=lambda topic: topic.key)
def test_a_key_is_said_by_the_sender_of_its_row_alone(topic) -> None:
    if "{service}" in topic.key:
        assert speakers("metrics/mapper") == {"mapper"}
        assert speakers("metrics/camera/2") == {"camera/2"}
    elif topic.sender == "camera":
        assert speakers(topic.key_for(2)) == {"camera/2"}
    else:
        key = topic.key_for(2) if "{camera}" in topic.key else topic.key
        assert speakers(key) == {topic.sender}


def test_truth_is_read_by_all_but_planner_and_mapper() -> None:
    readers = {role.name for role in roles(2) if "sim/state" in role.reads}
    assert readers == {role.name for role in roles(2)} - set(WITHOUT_TRUTH)


def test_only_those_who_command_may_ask_for_anything_under_ctl() -> None:
    asks = {role.name: [ask for ask in role.asks if ask.startswith("ctl/")] for role in roles(2)}
    assert {name for name, asked in asks.items() if "ctl/**" in asked} == set(COMMANDERS)
    # The simulator has those who build scenes build the next one, and may ask nothing else.
    assert asks.pop("simulator") == ["ctl/camera/*/prepare", "ctl/evaluator/prepare"]
    assert not any(asked for name, asked in asks.items() if name not in COMMANDERS)


def test_everybody_answers_its_own_requests_and_shows_its_own_token() -> None:
    for role in roles(3):
        assert f"ctl/{role.name}/*" in role.serves
        own = zenoh.KeyExpr(role.lives)
        others = {each.name.split("/")[0] for each in roles(3)} - {role.name.split("/")[0]}
        assert not any(own.intersects(zenoh.KeyExpr(f"alive/{other}/*")) for other in others)
    assert role_of("camera/1").lives == "alive/camera/1"


def test_every_service_of_the_topic_table_is_a_role() -> None:
    assert {topic.sender for topic in TOPICS} - {"camera", "all"} <= set(SINGLES)


def test_zenoh_takes_the_access_control_of_the_largest_ring() -> None:
    config = zenoh.Config()
    config.insert_json5("access_control", json.dumps(access_control(roles(MAX_CAMERAS))))
    assert json.loads(config.get_json("access_control/default_permission")) == "deny"
