"""Who may say, read, serve and ask what: the topic table, seen from each service.

A role is a service or, of those that are several, `service/instance`; it is the common name of a
certificate. `operator` is whoever steers: a viewer, or a command line, that was granted it.
"""

from dataclasses import dataclass

from schemas.camera import MAX_CAMERAS
from schemas.message import Message
from schemas.topics import TOPICS, Delivery, Topic

COMMANDERS = ("launcher", "operator")
"""These alone may send any request to `ctl/`."""
_ASKS = dict.fromkeys(COMMANDERS, ("ctl/**",)) | {
    "simulator": ("ctl/camera/*/prepare", "ctl/evaluator/prepare")
}
"""The simulator has others load a scene before it changes to it."""
ROUTERS_WORD = "@/*/router"
"""Where a router tells who has a session with it; everybody may ask."""
WITHOUT_TRUTH = ("planner", "mapper")
"""These must find out for themselves how the world is."""
SINGLES = (
    "router", "launcher", "operator", "simulator", "planner", "mapper", "evaluator", "recorder",
    "replay", "viewer", "inspector",
)  # fmt: skip


@dataclass(frozen=True)
class Role:
    """What one holder of a certificate may do; key expressions."""

    name: str
    says: tuple[str, ...]
    reads: tuple[str, ...]
    serves: tuple[str, ...]
    """Requests that it answers."""
    asks: tuple[str, ...]
    """Requests that it may make."""
    lives: str
    """Its liveliness token."""


def roles(num_cameras: int = MAX_CAMERAS) -> tuple[Role, ...]:
    """Return every role of a ring of so many cameras."""
    cameras = tuple(f"camera/{index}" for index in range(num_cameras))
    return tuple(role_of(name) for name in (*SINGLES, *cameras))


def role_of(name: str) -> Role:
    """Return what a service or `service/instance` may do."""
    service, _, instance = name.partition("/")
    asked = [_everywhere(topic) for topic in TOPICS if topic.delivery is Delivery.QUERY]
    return Role(
        name=name,
        says=tuple(key for topic in TOPICS if (key := _said(topic, service, instance))),
        reads=tuple(_everywhere(topic) for topic in TOPICS if _reads(topic, service)),
        serves=(
            f"ctl/{name}/*",
            *((ROUTERS_WORD,) if service == "router" else ()),
            *(topic.key for topic in TOPICS if _serves(topic, service)),
        ),
        asks=(ROUTERS_WORD, *asked, *_ASKS.get(service, ())),
        lives=f"alive/{service}/{instance or '*'}",
    )


def _reads(topic: Topic[Message], service: str) -> bool:
    return topic.delivery is not Delivery.QUERY and not (topic.truth and service in WITHOUT_TRUTH)


def _serves(topic: Topic[Message], service: str) -> bool:
    return topic.delivery is Delivery.QUERY and service in (topic.sender, "replay")


def _said(topic: Topic[Message], service: str, instance: str) -> str | None:
    """Return the key under which a service says it; None if it must not."""
    if topic.delivery is Delivery.QUERY:
        return None
    if service == "replay":
        return _everywhere(topic)  # It says again what all have said.
    if topic.sender == "all":
        return topic.key.format(service=f"{service}/{instance}" if instance else service)
    if topic.sender != service:
        return None
    return topic.expression(int(instance)) if service == "camera" else _everywhere(topic)


def _everywhere(topic: Topic[Message]) -> str:
    return topic.expression()
