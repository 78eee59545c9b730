"""Files that are there whole or not at all."""

import os
import secrets
from pathlib import Path


def replace(path: Path, data: bytes) -> None:
    """Write a file; whoever reads it, or a crash, meets the old one or the new one whole.

    Raises:
        OSError: If it cannot be written; nothing is left behind.
    """
    # Beside the file, because only within one file system is renaming one step.
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        with part.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
        _sync_folder(path.parent)
    finally:
        part.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Let the new name survive a loss of power, too, not only a crash of ours."""
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
