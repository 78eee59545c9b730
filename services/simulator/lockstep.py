"""Who must have acknowledged a tick before the next one begins."""

from collections.abc import Iterable

# The evaluator may score a tick while the next one is on its way.
_LAG_TICKS = {"evaluator": 1}


class Barrier:
    """The participants of lockstep, named `service` or `service/instance`.

    A participant is waited for from the moment it joins. One that is dropped for being late, or
    that was never announced, joins by acknowledging.
    """

    def __init__(self) -> None:
        self.tick = 0
        self._acknowledged: dict[str, int] = {}
        self._dropped: set[str] = set()

    def join(self, name: str) -> None:
        """Wait for `name` from the current tick on."""
        self._dropped.discard(name)
        self._acknowledged.setdefault(name, self.tick - 1)

    def leave(self, name: str) -> None:
        """Do not wait for `name` any more: it is gone."""
        self._acknowledged.pop(name, None)
        self._dropped.discard(name)

    def begin(self, tick: int) -> None:
        """Begin a tick: what is acknowledged from now on may be this one."""
        self.tick = tick

    def restart(self) -> None:
        """Begin anew at tick 0; the participants stay, also those that were dropped."""
        self.tick = 0
        self._acknowledged = dict.fromkeys({*self._acknowledged, *self._dropped}, -1)
        self._dropped.clear()

    def acknowledge(self, name: str, tick: int) -> None:
        """Note that `name` is done with `tick`; a tick that has not begun is of an earlier run."""
        if tick > self.tick:
            return
        self.join(name)
        self._acknowledged[name] = max(tick, self._acknowledged[name])

    def missing(self, strict: bool = False) -> tuple[str, ...]:
        """Return who has not acknowledged the current tick; if `strict` nobody may lag."""
        return in_order(
            name
            for name, tick in self._acknowledged.items()
            if tick < self.tick - (0 if strict else _LAG_TICKS.get(name.partition("/")[0], 0))
        )

    def drop(self, missing: tuple[str, ...]) -> None:
        """Wait no longer for those who are missing."""
        for name in missing:
            del self._acknowledged[name]
        self._dropped.update(missing)

    @property
    def dropped(self) -> tuple[str, ...]:
        """Who was given up on and has not come back."""
        return in_order(self._dropped)

    def waits_for_any(self, service: str) -> bool:
        """Whether some instance of `service` takes part."""
        return any(name.partition("/")[0] == service for name in self._acknowledged)


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Sort names by service, then by the instance's number."""

    def key(name: str) -> tuple[str, int, str]:
        service, _, instance = name.partition("/")
        return service, int(instance) if instance.isdecimal() else -1, instance

    return tuple(sorted(names, key=key))
