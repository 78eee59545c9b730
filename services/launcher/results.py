"""The folder of a run and what is put there at its end."""

import json
import shutil
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Self

from rich.console import Console

from services.launcher.chart import draw
from services.launcher.errors import LauncherError
from services.launcher.report import Record
from services.launcher.settings import RUNS_OWN, RunSettings
from services.launcher.summary import summary


@dataclass(frozen=True)
class Results:
    """Where a run leaves report.json, map.ply, coverage.png, settings.json and logs/."""

    settings: RunSettings
    folder: Path

    @classmethod
    def create(cls, settings: RunSettings) -> Self:
        """Make a new folder.

        Raises:
            LauncherError: If it, or a file that was asked for, cannot be written.
        """
        recording = settings.record
        if recording is not None and recording != RUNS_OWN and recording.exists():
            raise LauncherError(f"{recording} exists; give another name for the recording")
        now = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
        tries = (settings.runs / (now if n == 1 else f"{now}-{n}") for n in range(1, 100))
        folder = next(path for path in tries if not path.exists())
        try:
            folder.mkdir(parents=True)
            for path in (settings.report, settings.save_map, settings.record):
                if path is not None:
                    path.parent.mkdir(parents=True, exist_ok=True)
            (folder / "settings.json").write_text(settings.model_dump_json(indent=2) + "\n")
        except OSError as error:
            raise LauncherError(f"{error.filename}: {error.strerror}") from error
        return cls(settings, folder)

    @property
    def logs(self) -> Path:
        """Folder of the processes' logs."""
        return self.folder / "logs"

    @property
    def maps(self) -> dict[str, Path | None]:
        """Maps that the mapper shall save in the folder, and where each is then moved to."""
        wanted = self.settings.save_map
        return {"map.ply": None} | ({} if wanted is None else {f"wanted{wanted.suffix}": wanted})

    def write(self, record: Record, figures: dict[str, Any], console: Console) -> None:
        """Write the report and the chart, and print the summary."""
        path = self.folder / "report.json"
        path.write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n")
        if self.settings.report is not None:
            shutil.copyfile(path, self.settings.report)
        draw(record, self.folder / "coverage.png", self._title())
        console.print(summary(figures))
        console.print(f"results in {self.folder}")

    def _title(self) -> str:
        s = self.settings
        return (
            f"{Path(s.object).stem}, {s.deformation.partition(':')[0]}, path {s.path}: "
            f"{s.cameras} cameras at {s.resolution}, {s.voxel_size * 100:g} cm voxels"
        )
