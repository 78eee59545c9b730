"""The kinds of sources: a closed union."""

from typing import assert_never

from services.camera.sources.simulated import SimulatedSettings, SimulatedSource
from services.camera.sources.source import Source

SourceSettings = SimulatedSettings
"""A union by `kind`; the simulated source is the only one so far."""


def open_source(settings: SourceSettings) -> Source:
    """Open the source that the settings describe.

    Raises:
        MissingExtra: If what it needs is not installed.
    """
    match settings:
        case SimulatedSettings():
            return SimulatedSource(settings)
        case _:
            assert_never(settings)
