"""Another object, deformation or number of cameras: made ready beside the ticks, then taken."""

import logging
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.sim import SceneSpec
from services.runtime.bus import Bus
from services.runtime.errors import BadCommand, NoReply
from services.simulator.bodies import hull_corners
from services.simulator.changeable import Changeable
from services.simulator.settings import SimulatorSettings
from services.world.scene import Scene

logger = logging.getLogger(__name__)

_BUILDERS = ("camera", "evaluator")
"""These build the scene for themselves, when asked on `ctl/<service>[/<i>]/prepare`."""
_FIND_S = 1.0
"""A camera from elsewhere need not serve that: then it builds what it needs when it comes."""


@dataclass(frozen=True)
class Prepared:
    """A change that costs nothing any more."""

    wanted: Changeable
    spec: SceneSpec
    corners_m: NDArray[np.float32]
    """(K, 3) of the target's hull."""


class Changes:
    """Keeps what is in force, and what comes into force between two ticks."""

    def __init__(self, settings: SimulatorSettings, bus: Bus) -> None:
        self._settings, self._bus = settings, bus
        self.now = self._prepared(settings.changeable(), ())
        self._next: Prepared | None = None

    @property
    def wanted(self) -> Changeable:
        """What is in force, or will be after this tick."""
        return (self._next or self.now).wanted

    @property
    def num_cameras(self) -> int:
        """How many cameras the world has now, or has room for."""
        return self.now.wanted.cameras

    def expected(self) -> set[str]:
        """Return whom tick 0 waits for."""
        return {*self._settings.wait_for, *(f"camera/{i}" for i in range(self.num_cameras))}

    def begin(self, params: dict[str, Any], present: Collection[str]) -> Callable[[], Prepared]:
        """Check a change and return the work that it takes, for any thread.

        Args:
            params: names and values of `Changeable`.
            present: who is on the bus; those who build scenes are asked to build this one.

        Returns:
            A function that raises WorldError if the scene cannot be built here, and CommandFailed
            if not where one of those who are asked runs.

        Raises:
            BadCommand: If a name is unknown or the height is above its limit.
            ValidationError: If a value breaks its rule.
        """
        wanted = self.wanted.changed(params)
        most_m = self._settings.max_height_m
        if wanted.height_m > most_m:
            raise BadCommand(f"height_m must be at most {most_m:g}, got {wanted.height_m:g}")
        seed = self._settings.seed
        is_other = wanted.scene(seed) != self.wanted.scene(seed)
        builders = [name for name in present if name.partition("/")[0] in _BUILDERS]
        return lambda: self._prepared(wanted, builders if is_other else ())

    def adopt(self, prepared: Prepared) -> None:
        """Let a change come next."""
        self._next = prepared

    def take(self) -> bool:
        """Put into force what comes next; return whether there was anything."""
        if self._next is None:
            return False
        self.now, self._next = self._next, None
        return True

    def _prepared(self, wanted: Changeable, builders: Collection[str]) -> Prepared:
        spec = wanted.scene(self._settings.seed)
        corners_m = hull_corners(Scene.from_spec(spec).rest.vertices_m)
        if builders:
            with ThreadPoolExecutor(len(builders)) as pool:
                list(pool.map(lambda name: self._ask(name, spec), builders))
        return Prepared(wanted, spec, corners_m)

    def _ask(self, name: str, spec: SceneSpec) -> None:
        service, _, instance = name.partition("/")
        params = {"scene": spec.model_dump(mode="json")}
        patience_s = self._settings.start_timeout_s
        try:
            self._bus.request(service, "prepare", params, instance or None, patience_s, _FIND_S)
        except NoReply:
            logger.warning("%s does not say that it is ready for %s", name, spec.object)
