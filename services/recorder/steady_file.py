"""A file written in order and never half: what the disk does not take now, it takes later."""

import os
from pathlib import Path

from services.recorder.errors import CannotRecord


class SteadyFile:
    """The stream that an MCAP writer writes to.

    A full disk would leave half a record in the file and its writer out of step with it. Here
    `write` never fails: what is not taken waits, in order, and whoever writes asks `held_up`
    before going on. What has been written is the operating system's, and outlives our process.
    """

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        """Create the file.

        Raises:
            CannotRecord: If it is there already, or cannot be written.
        """
        flags = os.O_WRONLY | os.O_CREAT | (os.O_TRUNC if overwrite else os.O_EXCL)
        try:
            self._file = os.open(path, flags | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise CannotRecord(
                f"{path} exists; give another name, or --overwrite if it may go"
            ) from None
        except OSError as error:
            raise CannotRecord(f"{path} cannot be written: {error.strerror}") from None
        self._waiting = bytearray()
        self._length = 0
        self.error = ""
        """Why the disk does not take what waits; empty when nothing does."""

    def write(self, data: bytes | bytearray | memoryview) -> int:
        """Append."""
        self._length += len(data)
        if self._waiting:
            self._waiting += data
        else:
            written = self._take(memoryview(data))
            self._waiting += memoryview(data)[written:]
        return len(data)

    def tell(self) -> int:
        """Return the length, with what waits."""
        return self._length

    def flush(self) -> None:
        """Do nothing: there is no buffer of ours while the disk takes what comes."""

    @property
    def held_up(self) -> bool:
        """Try to write what waits; whether some of it still does."""
        if self._waiting:
            written = self._take(memoryview(bytes(self._waiting)))
            del self._waiting[:written]
        return bool(self._waiting)

    def close(self) -> int:
        """Close the file; return how many bytes could not be written."""
        left = len(self._waiting) if self.held_up else 0
        os.close(self._file)
        return left

    def _take(self, data: memoryview) -> int:
        """Write as much as the disk takes; return how much."""
        done = 0
        try:
            while done < len(data):
                done += os.write(self._file, data[done:])
        except OSError as error:
            self.error = error.strerror or str(error)
            return done
        self.error = ""
        return done
