"""What the simulator tells: the world's truth, the clock, and what a tracker sees of the target."""

from schemas.sim import SceneSpec
from schemas.topics import SIM_CLOCK, SIM_STATE, TARGET_OBSERVATION, TARGET_POSE
from services.runtime.bus import Bus
from services.simulator.clock import Clock
from services.simulator.messages import sim_clock, sim_state, target_pose
from services.simulator.tracker import Tracker
from services.simulator.world_state import World


class Teller:
    """Publishes one instant."""

    def __init__(self, bus: Bus, tracker: Tracker) -> None:
        self._bus, self._tracker = bus, tracker

    def tell_world(self, world: World, clock: Clock, scene: SceneSpec) -> None:
        """Tell all that is true at the instant that the world is at."""
        self._bus.publish(SIM_STATE, sim_state(world, clock, scene))
        self.tell_target(world)

    def tell_target(self, world: World) -> None:
        """Tell of the target alone."""
        self._bus.publish(TARGET_POSE, target_pose(world))
        seen = self._tracker.observation(world.motion, world.tick, world.t_ns)
        self._bus.publish(TARGET_OBSERVATION, seen)

    def tell_clock(
        self, world: World, clock: Clock, overruns: int, waiting_for: tuple[str, ...] = ()
    ) -> None:
        """Tell the time and who holds it up."""
        self._bus.publish(SIM_CLOCK, sim_clock(world, clock, waiting_for, overruns))
