"""What can go wrong in starting a run."""


class LauncherError(Exception):
    """Base of the launcher's errors; the text is for the user and says what to do."""


class SettingsError(LauncherError):
    """A setting that breaks its rule; the text names source, key, value, rule and choices."""


class MissingExtraError(LauncherError):
    """A part of encircle is not installed; the text names the extra."""


class ChildFailedError(LauncherError):
    """A process of the run cannot be kept alive."""
