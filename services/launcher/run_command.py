"""`encircle run`: its command line."""

import os
from collections.abc import Sequence


def run(args: Sequence[str]) -> int:
    """Carry out `encircle run` and return its exit code.

    Raises:
        SettingsError: If a setting is not usable.
        LauncherError: If the run could not be done.
    """
    from rich.console import Console

    from services.launcher.flags import parse_run

    console = Console(highlight=False, soft_wrap=True)
    settings = parse_run(args, os.environ)
    from services.launcher import run as whole  # Only now: what is heavy comes with it.

    return whole.run(settings, console)
