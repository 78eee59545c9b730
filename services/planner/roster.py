"""Who is there to be placed."""

from collections.abc import Container


class Roster:
    """Cameras by index: those that are counted on, those that came of their own, those lost."""

    def __init__(self) -> None:
        self._present: set[int] = set()
        self._lost: set[int] = set()

    def appear(self, camera: int) -> None:
        """Note that a camera is on the bus."""
        self._present.add(camera)
        self._lost.discard(camera)

    def vanish(self, camera: int) -> None:
        """Note that a camera has left the bus."""
        self._present.discard(camera)
        self._lost.add(camera)

    def crew(self, num: int, seen: Container[int]) -> tuple[tuple[int, ...], int]:
        """Return whom to place, and how many of them the formation of `num` has work for.

        A camera below `num` is counted on before it has shown itself, as the world may wait for
        its place; not after it was lost. One at or above `num` that is there, and was `seen`
        somewhere, fills a gap or is spare. With all lost there is nobody to make room for: the
        formation stays as it was.
        """
        joined = {camera for camera in self._present if camera in seen}
        there = sorted(({*range(num)} | joined) - self._lost)
        if not there:
            return tuple(range(num)), num
        return tuple(there), min(num, len(there))
