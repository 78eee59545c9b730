"""What can go wrong in an export."""

from services.recorder.errors import RecorderError


class ExportError(RecorderError):
    """A recording from which what is asked for cannot be made; the text says what it lacks."""
