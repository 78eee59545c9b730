"""The only folder in which requests may read and write files."""

from pathlib import Path

from services.mapper.errors import BadMapFile


class MapFolder:
    """Turns the paths of requests into paths within the folder.

    Whoever may send requests must not thereby write wherever the mapper's user may.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def to_write(self, path: str) -> Path:
        """Return where a file may be written.

        Raises:
            BadMapFile: If that is outside the folder, is a folder, or in one that does not exist.
        """
        place = self._within(path)
        if not place.parent.is_dir():
            raise BadMapFile(f"cannot write {path!r}: {place.parent} is no folder")
        if place.exists() and not place.is_file():
            raise BadMapFile(f"cannot write {path!r}: {place} is no file")
        return place

    def to_read(self, path: str) -> Path:
        """Return where a file may be read.

        Raises:
            BadMapFile: If that is outside the folder, or no file.
        """
        place = self._within(path)
        if not place.is_file():
            raise BadMapFile(f"cannot read {path!r}: {place} is no file")
        return place

    def _within(self, path: str) -> Path:
        try:
            # Links are followed first: one that leads out of the folder is outside of it.
            place = (self._folder / path).resolve()
        except (OSError, ValueError, RuntimeError) as error:
            raise BadMapFile(f"path {path!r:.200} is not usable: {error}") from error
        if not place.is_relative_to(self._folder):
            raise BadMapFile(
                f"path {path!r} lies outside {self._folder}, the folder for files (setting `files`)"
            )
        return place
