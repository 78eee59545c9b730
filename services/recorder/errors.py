"""What can be wrong with a recording."""


class RecorderError(ValueError):
    """Base of this package's errors."""


class BadRecording(RecorderError):
    """A file that is no recording of ours, or from which nothing can be read."""


class CannotRecord(RecorderError):
    """A file that cannot be written."""
