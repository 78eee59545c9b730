"""The README says what the code does."""

import tomllib
from pathlib import Path

import pytest

from schemas.topics import TOPICS

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BEGIN, END = "<!-- topics:", "<!-- end of topics -->"


def topic_table() -> str:
    rows = ["| key | message | rate | delivery | from |", "|---|---|---|---|---|"]
    for topic in TOPICS:
        name = getattr(topic.message, "__name__", "DepthCloud or XyzCloud")
        key = topic.key.replace("{camera}", "<i>").replace("{service}", "<service>[/<i>]")
        rate = f"{topic.rate_hz:g} Hz" if topic.rate_hz else "-"
        shared = ", shared memory" if topic.shared_memory else ""
        rows.append(
            f"| `{key}` | {name} | {rate} | {topic.delivery.value}{shared} | {topic.sender} |"
        )
    return "\n".join(rows)


def test_the_topic_table_is_the_one_in_the_code() -> None:
    between = README.split(BEGIN, 1)[1].split("-->", 1)[1].split(END, 1)[0]
    assert between.strip() == topic_table()


def test_every_scenario_is_named_and_every_named_one_exists() -> None:
    for path in (ROOT / "scenarios").glob("*.toml"):
        assert f"scenarios/{path.name}" in README
        assert "deformation" in tomllib.loads(path.read_text())


def test_every_local_link_and_picture_is_there() -> None:
    for target in (part.split(")", 1)[0] for part in README.split("](")[1:]):
        if "://" not in target:
            assert (ROOT / target).exists(), target
