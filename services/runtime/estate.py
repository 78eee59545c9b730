"""Shared memory of the dead: given back, as zenoh keeps it mapped and locked for good.

A process that reads from another's pool maps and locks all of it, and lets go of neither when the
other dies (eclipse-zenoh/zenoh#2787): 32 MiB for each death, and what exceeds the limit of locked
memory is dropped without a word (#2788). So who opens a pool leaves a note of it, held by a file
lock that ends with its process, across containers, too; and who reads looks for notes nobody holds.
"""

import contextlib
import ctypes
import fcntl
import logging
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import IO

logger = logging.getLogger(__name__)

SHM = Path("/dev/shm")  # nosec B108
"""Where zenoh has its segments; Linux's. Our notes lie there in a folder of our own."""
PERIOD_S = 10.0
"""A note that nobody holds is acted on when it is seen again: no message is under way any more."""
_SEGMENT = re.compile(r"\d+\.zenoh")
_MAPPING = re.compile(
    r"([0-9a-f]+)-([0-9a-f]+) rw-s .*/(\d+\.zenoh)(?: \(deleted\))?$", re.MULTILINE
)
_MADV_REMOVE = 9


def mapped() -> dict[str, list[tuple[int, int]]]:
    """Return zenoh's segments that this process has mapped: by name, addresses and sizes, bytes."""
    found: dict[str, list[tuple[int, int]]] = {}
    with contextlib.suppress(OSError):
        for begin, end, name in _MAPPING.findall(Path("/proc/self/maps").read_text()):
            address = int(begin, 16)
            found.setdefault(name, []).append((address, int(end, 16) - address))
    return found


class Will:
    """The note on our own segments."""

    def __init__(self, folder: Path = SHM) -> None:
        self._folder = folder
        self._before = set(mapped())
        self._note: IO[str] | None = None

    def enter(self, size: int) -> bool:
        """Enter the pool of so many bytes that was opened since; return whether it is known.

        Others' pools may have been mapped meanwhile: if more than one fits, none is entered.
        """
        found = mapped()
        ours = [
            name
            for name in found.keys() - self._before
            if sum(length for _, length in found[name]) == size
        ]
        if len(ours) != 1:
            return False
        try:
            place = _place(self._folder)
            hidden = place / f".{secrets.token_hex(8)}"
            note = hidden.open("x")
            fcntl.flock(note, fcntl.LOCK_EX | fcntl.LOCK_NB)
            note.write(ours[0])
            note.flush()
            hidden.rename(place / f"{secrets.token_hex(8)}.note")  # Nobody sees it unheld.
        except OSError as error:
            logger.debug("no note of the shared pool: %s", error)
            return False
        self._note = note
        return True


class Heir:
    """Gives back what this process has mapped of the dead's pools."""

    def __init__(self, folder: Path = SHM) -> None:
        self._folder = folder
        self._seen: set[Path] = set()
        self._done: set[str] = set()

    def tend(self) -> int:
        """Look at all notes; return how many bytes were given back."""
        dead = dict(_notes_of_the_dead(self._folder))
        due = {name for path, name in dead.items() if path in self._seen} - self._done
        self._seen = set(dead)
        for path, name in dead.items():
            if not (self._folder / name).exists():  # The last who had it mapped has gone, too.
                path.unlink(missing_ok=True)
        if not due:
            return 0
        given = 0
        for name, places in mapped().items():
            if name in due:
                given += sum(size for address, size in places if _give_back(address, size))
        self._done |= due
        if given:
            logger.info("gave back %.0f MB of shared memory of senders that died", given / 1e6)
        return given


def _notes_of_the_dead(folder: Path) -> Iterator[tuple[Path, str]]:
    with contextlib.suppress(OSError):
        for path in _place(folder).glob("*.note"):
            with contextlib.suppress(OSError), path.open() as note:
                fcntl.flock(note, fcntl.LOCK_SH | fcntl.LOCK_NB)  # Fails while its writer lives.
                if _SEGMENT.fullmatch(name := note.read(64)):
                    yield path, name


def _place(folder: Path) -> Path:
    """Return where the notes of this user are.

    Raises:
        OSError: If it cannot be made, or is another user's.
    """
    place = folder / f"encircle-{os.getuid()}"
    place.mkdir(mode=0o700, exist_ok=True)
    if place.is_symlink() or place.stat().st_uid != os.getuid():
        raise PermissionError(f"{place} is not ours")
    return place


def _give_back(address: int, size: int) -> bool:
    """Unlock a mapping and free its pages; whoever reads there later finds zeros."""
    libc = ctypes.CDLL(None, use_errno=True)
    begin, length = ctypes.c_void_p(address), ctypes.c_size_t(size)
    return bool(libc.munlock(begin, length) == 0 and libc.madvise(begin, length, _MADV_REMOVE) == 0)
