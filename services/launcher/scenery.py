"""Another object while a run goes on concerns more than the simulator."""

import logging
from typing import Any

from schemas.sim import SceneSpec
from services.launcher.fleet import Ask
from services.runtime.errors import RuntimeFault

logger = logging.getLogger(__name__)


class Scenery:
    """Tells planner and mapper what they cannot see for themselves.

    The planner looks at the middle of the new object. The map forgets the old one: what it knew of
    the inside of the new one no camera could ever clear.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._last: SceneSpec | None = None
        self._untold: dict[str, tuple[str, dict[str, Any]]] = {}
        """By service: the verb and parameters that it has yet to carry out."""

    def update(self, scene: SceneSpec) -> None:
        """Take in the scene as it is now; who could not be told is told at the next call."""
        last, self._last = self._last, scene
        if (
            last is not None
            and scene.model_copy(update={"deformations": last.deformations}) != last
        ):
            self._untold["mapper"] = ("reset", {})
            if scene.height_m != last.height_m:
                self._untold["planner"] = ("set", {"centre_height_m": scene.height_m / 2})
        for service, (verb, params) in list(self._untold.items()):
            try:
                self._ask(service, verb, params)
            except RuntimeFault as error:
                logger.warning("%s is not told of %s yet: %s", service, scene.object, error)
            else:
                del self._untold[service]
