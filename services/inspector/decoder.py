"""What `zenoh subscribe --decoder encircle` prints: zenoh-cli finds it by its entry point."""

from services.inspector.description import describe


def decode_line(key: object, payload: bytes) -> str:
    """Return one line about a payload; arrays are summarised, never dumped.

    Args:
        key: zenoh's key expression, or its text.
        payload: As it was received.
    """
    return describe(str(key), payload).line
