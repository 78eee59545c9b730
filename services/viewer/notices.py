"""What is missing, in words, with the command that mends it: an empty view is never silent."""

from collections.abc import Set
from dataclasses import dataclass, field

from schemas.sim import SimClock
from schemas.topics import (
    CAMERA_CLOUD,
    CAMERA_POSE,
    FORMATION,
    MAP_CHANGES,
    QUALITY,
    TARGET_ESTIMATE,
    TARGET_POSE,
)
from services.runtime.settings import BusSettings
from services.viewer.newest import Newest

_USUAL_ROUTER = BusSettings.model_fields["connect"].default

SILENT_S = 3.0
"""A stream is missed when nothing has come for so long."""


@dataclass(frozen=True)
class Stream:
    """What a part of the picture is drawn from."""

    keys: tuple[str, ...]
    """Any of them will do."""
    shows: str
    service: str
    command: str


STREAMS = (
    Stream(
        (TARGET_POSE.key, TARGET_ESTIMATE.key),
        "the target and its path",
        "simulator",
        "encircle simulator",
    ),
    Stream((FORMATION.key,), "the formation", "planner", "encircle planner"),
    Stream((CAMERA_POSE.key,), "the cameras", "camera", "encircle camera --camera 0"),
    Stream((CAMERA_CLOUD.key,), "what the cameras see", "camera", "encircle camera --camera 0"),
    Stream((MAP_CHANGES.key,), "the map", "mapper", "encircle mapper"),
    Stream((QUALITY.key,), "coverage and F-score", "evaluator", "encircle evaluator"),
)


@dataclass(frozen=True)
class Situation:
    """What is known of the run."""

    now_s: float
    """Monotonic."""
    since_s: float
    """When somebody began to look: before, nobody listened."""
    router: str
    """Where we look for the others."""
    alive: Set[str]
    """Services, without their instances."""
    newest: Newest
    num_occupied: int | None
    """None before the first map."""
    num_drawn: int = 0
    refusals: dict[str, str] = field(default_factory=dict)
    """By service: the last message that it refused, and why."""


def notices(situation: Situation) -> list[str]:
    """Return what is missing or in the way, the most telling first; empty when all flows."""
    alive = situation.alive - {"viewer"}
    clock = situation.newest.clock
    if not alive and not _flows(situation, MAP_CHANGES.key):
        return [
            f"Nobody is on the bus at `{situation.router}`. Start everything with `encircle run`, "
            "or tell this viewer where the router is: "
            "`encircle viewer --bus.connect tcp/HOST:PORT`."
        ]
    if "replay" in alive and "simulator" not in alive:
        return _replay(situation)
    found = [] if clock is None else _clock(clock)
    stands = clock is not None and clock.state in ("paused", "finished")
    found += [line for stream in STREAMS if (line := _missing(situation, stream, stands))]
    if situation.num_occupied == 0 and not found:
        found.append(
            "The map has no occupied voxel: the cameras see nothing in the mapper's box. "
            "Look at the camera images, and at the box with "
            "`encircle mapper --help` (`--box-min-m`, `--box-max-m`)."
        )
    found += [
        f"{service} refuses messages: {reason}" for service, reason in situation.refusals.items()
    ]
    return found


def _clock(clock: SimClock) -> list[str]:
    found = []
    match clock.state:
        case "paused":
            found.append(f"Paused at tick {clock.tick}: press Resume or Step.")
        case "finished":
            found.append(
                f"The run is over after {clock.tick + 1} ticks: press Reset, "
                "or let the next go on with `encircle run --forever`."
            )
        case "waiting" if clock.waiting_for:
            found.append(f"Tick {clock.tick} waits for {', '.join(clock.waiting_for)}.")
    if clock.dropped:
        found.append(f"Given up on {', '.join(clock.dropped)}: no answer in time.")
    return found


def _replay(situation: Situation) -> list[str]:
    silent = [stream for stream in STREAMS if not _flows(situation, *stream.keys)]
    if situation.now_s - situation.since_s < SILENT_S or not silent:
        return []
    if len(silent) == len(STREAMS):
        return ["The replay stands still: press Resume replay, or seek."]
    return [
        f"The recording has no `{stream.keys[0].replace('{camera}', '*')}` here, hence "
        f"{stream.shows} cannot be shown."
        for stream in silent
    ]


def _flows(situation: Situation, *keys: str) -> bool:
    heard = [situation.newest.heard_s.get(key, -1e9) for key in keys]
    return max(heard) > situation.now_s - SILENT_S


def _missing(situation: Situation, stream: Stream, stands: bool) -> str | None:
    watched_s = situation.now_s - situation.since_s
    if _flows(situation, *stream.keys) or watched_s < SILENT_S:
        return None
    known = [
        situation.newest.heard_s[key] for key in stream.keys if key in situation.newest.heard_s
    ]
    silent_s = min([watched_s, *(situation.now_s - heard for heard in known)])
    key = stream.keys[0].replace("{camera}", "*")
    told = f"No `{key}` for {silent_s:.0f} s, hence {stream.shows} cannot be shown"
    if stream.service not in situation.alive:
        command = f"{stream.command}{_flags(situation.router)}"
        return f"{told}: no {stream.service} is running. Start it: `{command}`."
    if stands:
        return None  # The clock is why, and has been named.
    doctor = f"encircle doctor{_flags(situation.router)}"
    return f"{told}, though a {stream.service} is running: `{doctor}` says what holds it up."


def _flags(router: str) -> str:
    """Return what a command has to be told to find our bus."""
    return "" if router == _USUAL_ROUTER else f" --bus.connect {router}"


def summary_line(situation: Situation) -> str:
    """Return one line about what is drawn."""
    clock, newest = situation.newest.clock, situation.newest
    parts = [] if clock is None else [f"tick {clock.tick}", clock.state]
    if newest.poses:
        parts.append(f"{len(newest.poses)} camera{'s' if len(newest.poses) > 1 else ''}")
    if situation.num_occupied is not None:
        voxels = f"{situation.num_occupied:,} voxels"
        if situation.num_drawn < situation.num_occupied:
            voxels += f", {situation.num_drawn:,} drawn"
        parts.append(voxels)
    if newest.summary is not None:
        parts.append(f"fused in {newest.summary.fuse_ms:.0f} ms")
    return " · ".join(parts)
