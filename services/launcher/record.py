"""`encircle record`, and a word on what a run has recorded."""

from collections.abc import Sequence

from services.launcher.extras import check_installed
from services.runtime.bus import Bus
from services.runtime.errors import RuntimeFault


def record(args: Sequence[str]) -> int:
    """Record until SIGINT or SIGTERM.

    Raises:
        MissingExtraError: If what writes recordings is not installed.
    """
    check_installed("recorder")
    from services.recorder.record import main

    main(args)
    return 0


def record_line(bus: Bus) -> str:
    """Return what the recorder of a run has done so far."""
    try:
        state = bus.request("recorder", "get")
    except RuntimeFault as error:
        return f"nothing is known of the recording: {error}"
    num_dropped, num_lost = (sum(state[name].values()) for name in ("dropped", "lost"))
    held_up = f"; HELD UP: {state['held_up']}" if state["held_up"] else ""
    return (
        f"recorded {state['records']} samples, {state['bytes'] / 1e6:.1f} MB, {num_dropped} "
        f"dropped, {num_lost} lost, into {state['file']}{held_up}"
    )
