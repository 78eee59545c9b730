"""The README says what the code does."""

import tomllib
from pathlib import Path

import pytest

from schemas.topics import TOPICS
from services.mapper.fusion import MemorySettings
from services.mapper.requests import VERBS

pytestmark = pytest.mark.unit

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BEGIN, END = "<!-- topics:", "<!-- end of topics -->"
BEGIN_VERBS, END_VERBS = "<!-- verbs:", "<!-- end of verbs -->"


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


def verb_table() -> str:
    kinds = {**VERBS, "set": MemorySettings}
    rows = ["| `ctl/mapper/...` | parameters | what for |", "|---|---|---|"]
    for verb, kind in sorted(kinds.items()):
        names = ", ".join(f"`{name}`" for name in kind.model_fields) or "-"
        rows.append(f"| `{verb}` | {names} | {kind.__doc__.split(chr(10))[0]} |")
    return "\n".join(rows)


def test_the_table_of_the_mappers_verbs_is_the_one_in_the_code() -> None:
    between = README.split(BEGIN_VERBS, 1)[1].split("-->", 1)[1].split(END_VERBS, 1)[0]
    assert between.strip() == verb_table()


def python_blocks() -> list[str]:
    return [part.split("```", 1)[0] for part in README.split("```python\n")[1:]]


def test_the_example_prints_what_it_says(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    example = next(block for block in python_blocks() if "VoxelMap" in block)
    said = [line.split("  # ", 1)[1] for line in example.splitlines() if line.startswith("print(")]
    exec(example, {})
    printed = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert printed == said
    assert len(said) == 4


def test_every_request_in_the_readme_is_one() -> None:
    asked: list[tuple[str, dict[str, object]]] = []

    class Bus:
        def request(self, service: str, verb: str, params: dict[str, object]) -> None:
            assert service == "mapper"
            asked.append((verb, params))

    for block in python_blocks():
        if "bus.request" in block:
            exec(block, {"bus": Bus()})
    assert len(asked) == 2
    for verb, params in asked:
        kind = MemorySettings if verb == "set" else VERBS[verb]
        kind.model_validate(params)


def test_every_scenario_is_named_and_every_named_one_exists() -> None:
    for path in (ROOT / "scenarios").glob("*.toml"):
        assert f"scenarios/{path.name}" in README
        assert "deformation" in tomllib.loads(path.read_text())


def links_of(text: str) -> list[str]:
    return [part.split(")", 1)[0] for part in text.split("](")[1:]]


def anchors_of(text: str) -> set[str]:
    """Return what may stand behind a `#`: headings as GitHub names them."""
    heads = [line.lstrip("# ") for line in text.splitlines() if line.startswith("#")]
    return {
        "".join(c for c in head.lower() if c.isalnum() or c in " -_").replace(" ", "-")
        for head in heads
    }


@pytest.mark.parametrize(
    "page", ["README.md", *sorted(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]
)
def test_every_local_link_and_picture_is_there(page: str) -> None:
    for target in links_of((ROOT / page).read_text()):
        if "://" not in target:
            name, _, anchor = target.partition("#")
            path = (ROOT / page).parent / name if name else ROOT / page
            assert path.exists(), target
            assert not anchor or anchor in anchors_of(path.read_text()), target
