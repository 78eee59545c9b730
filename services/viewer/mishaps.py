"""What could not be drawn: counted, told once, and no reason to stop drawing."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

logger = logging.getLogger(__name__)


class Mishaps:
    """Guards what draws from others' words: valid messages may still say what nobody can draw."""

    def __init__(self) -> None:
        self.num_failed = 0
        self._said: dict[str, str] = {}
        self._logged: set[str] = set()

    @contextmanager
    def guarding(self, what: str) -> Iterator[None]:
        """Count what goes wrong within; it is over as soon as all goes well within."""
        try:
            yield
        except (ValueError, TypeError, ArithmeticError) as error:
            self.num_failed += 1
            self._said[what] = f"{type(error).__name__}: {error}"[:200]
            if what not in self._logged:
                self._logged.add(what)
                logger.warning("%s cannot be shown", what, exc_info=True)
        else:
            self._said.pop(what, None)

    @property
    def lines(self) -> list[str]:
        """What cannot be shown now, and why."""
        return [f"The {what} cannot be shown: {why}" for what, why in self._said.items()]
