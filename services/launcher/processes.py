"""The process table of a run: who is started, with which flags."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ProcessSpec:
    """One process to keep alive."""

    name: str
    """Unique in the run; also the name of its log."""
    argv: tuple[str, ...]
    env: Mapping[str, str] = field(default_factory=dict)
    """On top of the launcher's own."""
