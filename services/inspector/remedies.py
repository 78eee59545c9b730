"""Which command mends what is missing."""

from schemas.sim import SimClock

START = "encircle run"
"""Starts everything; it prints where its router listens."""

FASTER = "encircle run with fewer --cameras or a lower --resolution"
"""What a machine that is too slow can be given."""

_OPTIONAL = {
    "cams/{camera}/color": "ENCIRCLE_CAMERA_COLOR=1 encircle run",
    "target/estimate": "encircle run --target filtered",
    "metrics/quality": "encircle evaluator",
}
"""Streams that are only sent when asked for."""


def start(address: str, connect: str) -> str:
    """The command that starts a service where the others are."""
    service, _, instance = address.partition("/")
    flag = f" --camera {instance}" if service == "camera" and instance else ""
    return f"encircle {service}{flag} --bus.connect {connect}"


def router(connect: str) -> str:
    """The command that hosts a router at an endpoint."""
    return f"encircle router --listen {connect}"


def optional(row_key: str) -> str:
    """The command that has an optional stream sent; empty when it is none."""
    return _OPTIONAL.get(row_key, "")


def for_clock(clock: SimClock, connect: str) -> str:
    """What lets a simulation that stands go on; empty when it runs."""
    if clock.waiting_for:
        return start(clock.waiting_for[0], connect)
    match clock.state:
        case "paused":
            return "request ctl/simulator/resume"
        case "finished":
            return START
        case _:
            return ""
