"""A number of mutants against living services, and what became of them."""

import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schemas.camera import MAX_CAMERAS, Intrinsics
from schemas.cloud import DepthCloud
from schemas.codec import encode
from schemas.geometry import Pose
from schemas.message import Envelope, Message
from schemas.sim import SceneSpec
from schemas.topics import Topic, find
from tests.examples import ENVELOPE, EXAMPLES
from tests.fuzz.mutation import Mutator
from tests.fuzz.victims import Victim

SERVICES = ("mapper", "planner", "evaluator", "viewer")
_RETOLD = 0.1
"""Of all: valid messages of other instants and senders."""
_SCENE = SceneSpec(object="sphere", height_m=0.4, subdivide=0, deformations=(), seed=7)


@dataclass
class Outcome:
    """What a campaign found."""

    num_sent: int = 0
    num_bad: int = 0
    """Invalid: counted by the service that got them, each once."""
    num_refused: int = 0
    """Valid, but nothing that the service's core can work with; counted, too."""
    how: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0
    rss_mib: list[tuple[int, float]] = field(default_factory=list)
    slowest: dict[str, tuple[float, str]] = field(default_factory=dict)

    @property
    def growth_mib(self) -> float:
        """From the middle, when all is warm, to the end."""
        return self.rss_mib[-1][1] - self.rss_mib[len(self.rss_mib) // 2][1]


def run(victims: dict[str, Victim], num: int, seed: int, tell: Callable[[str], None]) -> Outcome:
    """Send so many mutants; raises what a service raised, with the mutant's number."""
    mutator, outcome = Mutator(seed), Outcome()
    seeds = {
        name: [(topic, payload) for topic, payload in _seeds() if topic.key in each.bus.puts]
        for name, each in victims.items()
    }
    names, began_s = tuple(victims), time.monotonic()
    for number in range(num):
        if number % max(1, num // 50) == 0:
            outcome.rss_mib.append((number, rss_mib()))
        name = mutator.pick(names)
        topic, payload = mutator.pick(seeds[name])
        key, how, is_bad = _key(topic, mutator), "retold", False
        if mutator.number(1000) < 1000 * _RETOLD:
            payload = mutator.retold(payload)
        else:
            payload, how, is_bad = mutator.mutant(payload)
        try:
            is_valid = victims[name].send(key, payload)
        except Exception as error:
            error.add_note(
                f"mutant {number} of seed {seed}: {name}, {key}, {how}, {payload!r:.1000}"
            )
            raise
        if is_valid and is_bad:
            raise AssertionError(f"{number}: {key}: {how} was taken for valid: {payload!r:.1000}")
        outcome.how[how.split()[0]] += 1
    outcome.rss_mib.append((num, rss_mib()))
    outcome.seconds = time.monotonic() - began_s
    for name, each in victims.items():
        outcome.num_sent += each.num_sent
        outcome.num_bad += each.num_bad
        outcome.num_refused += each.num_refused
        outcome.slowest[name] = each.slowest
        least, told = each.num_bad + each.num_refused, each.told_bad
        slowest_s, slowest_key = each.slowest
        tell(
            f"{name}: {each.num_sent} sent, {each.num_bad} bad, {each.num_refused} refused, its "
            f"heartbeat says {told}; the slowest took {slowest_s * 1e3:.0f} ms, {slowest_key}"
        )
        assert told >= least, f"{name} tells {told} bad messages; it was sent {least}"
    return outcome


def rss_mib() -> float:
    """Return this process's resident memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _key(topic: Topic[Message], mutator: Mutator) -> str:
    if "{camera}" in topic.key:
        # One in twenty comes under another camera's key.
        return topic.key_for(mutator.number(MAX_CAMERAS) if mutator.number(20) == 0 else 3)
    if "{service}" in topic.key:
        return topic.key_for(service="camera/3")
    return topic.key_for()


def _seeds() -> list[tuple[Topic[Message], bytes]]:
    made = []
    for topic, message in EXAMPLES.values():
        assert find(_key(topic, Mutator(1))) is topic
        if hasattr(message, "scene"):
            # A body that is quickly built: scenes differ in what they cost, not in what they say.
            message = message.model_copy(update={"scene": _SCENE})
        made.append((topic, encode(message, ENVELOPE).join()))
    return made


def good(name: str, tick: int, boot: str, **changed: Any) -> bytes:
    """Return a valid example message of an instant, from a sender that is new."""
    message = EXAMPLES[name][1]
    if hasattr(message, "scene"):
        changed.setdefault("scene", _SCENE)
    told = message.model_copy(update={"tick": tick, "t_ns": tick * 66_666_667, **changed})
    envelope = Envelope(seq=0, src="camera/3", boot=boot, t_pub_ns=time.time_ns())
    return encode(told, envelope).join()


def looking_down() -> bytes:
    """Return a cloud of camera 3 that sees a floor 0.6 m below it, in instant 1000."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 0.6
    optics = Intrinsics(width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
    cloud = DepthCloud.of(
        np.full((48, 64), 600, "<u2"), t_ns=66_666_667_000, tick=1000, frame_id="world", camera=3,
        pose=Pose.from_matrix(T), max_range_m=5.0, t_capture_ns=time.time_ns(), intrinsics=optics,
        depth_scale_m=0.001,
    )  # fmt: skip
    envelope = Envelope(seq=0, src="camera/3", boot="good", t_pub_ns=time.time_ns())
    return encode(cloud, envelope).join()
