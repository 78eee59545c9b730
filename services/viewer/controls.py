"""What can be steered, by whom it is done, and how what a service reports is shown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Reports = Mapping[str, Mapping[str, Any]]
"""By service: what it last answered to `get`."""


@dataclass(frozen=True)
class Number:
    """A number within limits."""

    minimum: float
    maximum: float
    step: float


@dataclass(frozen=True)
class Choice:
    """One of several words; what is reported and not among them is one more."""

    choices: tuple[str, ...]


@dataclass(frozen=True)
class Control:
    """One setting of one service."""

    label: str
    kind: Number | Choice
    owners: tuple[tuple[str, str], ...]
    """(service, parameter); the first that reports the parameter is asked."""
    hint: str

    def owner(self, reports: Reports) -> tuple[str, str] | None:
        """Return who is to be asked; None if nobody reports the value."""
        for service, parameter in self.owners:
            if reports.get(service, {}).get(parameter) is not None:
                return service, parameter
        return None

    def shown(self, reports: Reports) -> float | str | None:
        """Return the reported value; None if there is none, or none of the right kind."""
        owner = self.owner(reports)
        if owner is None:
            return None
        value = reports[owner[0]][owner[1]]
        match self.kind:
            case Number():
                return number(value)
            case Choice() if isinstance(value, str):
                return value
        return None

    def request(self, value: float | str, reports: Reports) -> tuple[str, dict[str, Any]] | None:
        """Return the service and what to `set`; None if nobody can be asked.

        Raises:
            ValueError: If a number is not within its limits.
        """
        owner = self.owner(reports)
        if owner is None:
            return None
        if isinstance(self.kind, Number):
            asked, low, high = number(value), self.kind.minimum, self.kind.maximum
            if asked is None or not low <= asked <= high:
                raise ValueError(f"{self.label} must be {low:g}..{high:g}, got {value!r:.40}")
            value = int(asked) if self.kind.step >= 1 else asked
        return owner[0], {owner[1]: value}


def number(value: object) -> float | None:
    """Return what a service or a browser calls a number; None if it is none, or not finite."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        found = float(value)
    except OverflowError:  # An int of any size comes over the bus.
        return None
    return found if math.isfinite(found) else None


CLOCK_VERBS = ("Pause", "Resume", "Step", "Reset")
"""Each a request to the simulator, in lower case."""

CONTROLS = (
    Control(
        "Cameras",
        Number(1, 64, 1),
        (("launcher", "cameras"), ("planner", "cameras")),
        "How many cameras surround the target.",
    ),
    Control(
        "Radius (m)",
        Number(0.1, 100.0, 0.05),
        (("planner", "radius_m"),),
        "From the target's centre to the cameras.",
    ),
    Control(
        "Elevation (deg)",
        Number(-85.0, 85.0, 0.5),
        (("planner", "elevation_deg"),),
        "Of the cameras above the horizontal.",
    ),
    Control(
        "Strategy",
        Choice(
            (
                *("circle", "adaptive_scale", "constant_angles", "adaptive_angles"),
                *("rings", "sphere", "orbit", "random", "static", "dome"),
            )
        ),
        (("planner", "strategy"),),
        "Where the cameras are.",
    ),
    Control(
        "Drive",
        Choice(("flying", "unicycle")),
        (("planner", "drive"),),
        "Cameras fly, or robots with wheels carry them.",
    ),
    Control(
        "Object",
        Choice(("bunny", "sphere", "box", "torus")),
        (("simulator", "object"),),
        "What is looked at.",
    ),
    Control(
        "Deformation",
        Choice(("rigid", "breathing", "squash", "bend", "twist", "wave", "breathing+bend")),
        (("simulator", "deformation"),),
        "How it moves in itself.",
    ),
    Control(
        "Map memory",
        Choice(("instant", "decay", "persistent")),
        (("mapper", "memory"),),
        "What the map keeps of what was seen before.",
    ),
)

POLLED = ("simulator", "planner", "mapper", "launcher", "replay")
"""Whose `get` is asked once a second while somebody looks."""
