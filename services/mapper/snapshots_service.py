"""Saves the map now and then, beside the work, and has it again after a restart."""

import logging
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from services.mapper.errors import MapperError
from services.mapper.fusion import Fusion
from services.mapper.report import Reporter
from services.mapper.settings import MapperSettings
from services.mapper.snapshot import About, Snapshot
from services.runtime.loop import Gate, Loop

logger = logging.getLogger(__name__)


class Snapshots(Protocol):
    """What the map survives a crash by."""

    def begin(self, loop: Loop, between_instants: Gate) -> None:
        """Restore what was saved, and save from now on."""

    def forget(self) -> None:
        """The map is another one from here on: what was saved is not to come back."""


class NoSnapshots:
    """After a crash the map begins empty."""

    def begin(self, loop: Loop, between_instants: Gate) -> None:
        """Do nothing."""

    def forget(self) -> None:
        """Do nothing."""


class SavedSnapshots:
    """One file; the map is copied between instants, and packed and written on a thread."""

    def __init__(
        self, snapshot: Snapshot, settings: MapperSettings, fusion: Fusion, reporter: Reporter
    ) -> None:
        self._snapshot, self._settings = snapshot, settings
        self._fusion, self._reporter = fusion, reporter
        self._worker = ThreadPoolExecutor(1, "snapshot")
        self._writing: Future[None] | None = None
        self._saved_rev = 0
        self._trouble = ""

    def begin(self, loop: Loop, between_instants: Gate) -> None:
        """Restore what was saved, or say that the map begins empty; save from now on."""
        self._restore()
        period_s = self._settings.snapshot_every_s
        loop.every(period_s, lambda: between_instants(self._save))
        loop.at_end(self._end)

    def forget(self) -> None:
        """Remove what was saved, also what is being written."""
        self._finish()
        self._snapshot.forget()

    def _restore(self) -> None:
        path = self._settings.snapshot
        try:
            restored = self._snapshot.restore(self._fusion.voxel_map, self._settings.frame)
        except MapperError as error:
            logger.error("the map begins empty: snapshot %s is refused: %s", path, error)
            return
        if restored is None:
            logger.info("the map begins empty: no snapshot at %s", path)
            return
        counts = self._fusion.voxel_map.counts()
        logger.info(
            "the map is restored from %s: %d occupied and %d free voxels of tick %d, saved %.1f s "
            "ago; what was fused since then is lost",
            path, counts.occupied, counts.free, restored.tick, restored.age_s,
        )  # fmt: skip

    def _save(self) -> None:
        """Save what is new, unless the last is still being written."""
        if self._writing is not None and not self._writing.done():
            return
        self._finish()
        if self._fusion.memory.memory != "persistent":
            self._snapshot.forget()
            return
        if self._reporter.rev == self._saved_rev:
            return
        self._saved_rev = self._reporter.rev
        about = About(frame=self._settings.frame, tick=self._reporter.tick)
        stored = self._fusion.voxel_map.stored()
        self._writing = self._worker.submit(self._snapshot.save, stored, about)

    def _finish(self) -> None:
        """Wait for what is being written; a trouble is told once."""
        if self._writing is None:
            return
        error = self._writing.exception()
        self._writing = None
        trouble = "" if error is None else str(error)
        if trouble and trouble != self._trouble:
            logger.warning("no snapshot: %s; the one before stays", trouble)
        self._trouble = trouble

    def _end(self) -> None:
        self._finish()
        self._save()
        self._finish()
        self._worker.shutdown()


def snapshots_of(settings: MapperSettings, fusion: Fusion, reporter: Reporter) -> Snapshots:
    """Return what the settings ask for."""
    if settings.snapshot is None:
        return NoSnapshots()
    return SavedSnapshots(Snapshot(settings.snapshot), settings, fusion, reporter)
