"""The recorder's process."""

import sys
from collections.abc import Sequence

from services.recorder.service import RecorderService
from services.recorder.settings import RecorderSettings
from services.runtime.service import main as serve

_SWITCH_S = 0.0005
"""zenoh's threads, which hand over what has come, must not wait Python's 5 ms for the writer."""


def main(args: Sequence[str] | None = None) -> None:
    """Record until SIGINT or SIGTERM."""
    sys.setswitchinterval(_SWITCH_S)
    serve(RecorderSettings, "recorder", RecorderService, args, command="record")
