"""`encircle replay`."""

from collections.abc import Sequence

from services.launcher.extras import check_installed


def replay(args: Sequence[str]) -> int:
    """Replay a recording until its end, SIGINT or SIGTERM.

    Raises:
        MissingExtraError: If what reads recordings is not installed.
    """
    check_installed("recorder")
    from services.recorder.replay_service import main

    main(args)
    return 0
