"""What `ctl/simulator/get` answers."""

from typing import Any

from services.simulator.changeable import Changeable
from services.simulator.clock import Clock
from services.simulator.traffic import Traffic
from services.simulator.world_state import World


def figures(
    world: World, clock: Clock, traffic: Traffic, wanted: Changeable, overruns: int
) -> dict[str, Any]:
    """Return the clock, what has been counted, and what was last asked of the world."""
    asked = wanted.model_dump(mode="json")
    return {
        "state": clock.state,
        "tick": world.tick,
        "t_ns": world.t_ns,
        "cameras": sorted(world.cameras),
        "expected_cameras": asked.pop("cameras"),
        "waiting_for": list(clock.waiting_for(world.placed())),
        "dropped": list(clock.dropped),
        "overruns": overruns,
        "clipped_commands": world.num_clipped,
        "sideways_commands": world.num_sideways,
        **traffic.counts(),
        **asked,
    }
