"""The roles in zenoh's words: its access control, which every session enforces on every link."""

from collections.abc import Iterator, Sequence
from typing import Any

from services.runtime.roles import Role

_LIVENESS = ["liveliness_query", "declare_liveliness_subscriber"]
_RELAY = "router"
"""It passes on what others said, after it has held them to their roles itself."""


def access_control(roles: Sequence[Role]) -> dict[str, Any]:
    """Return zenoh's `access_control`: what is not allowed by the roles is denied.

    What comes in is held against the role of whoever sent it, so that nobody speaks for another;
    what goes out against the role of whoever would get it, so that nobody reads what it must not.
    """
    rules: list[dict[str, Any]] = []
    policies = []
    for role in roles:
        own = [
            _rule(f"{role.name} {number}", flow, messages, keys)
            for number, (flow, messages, keys) in enumerate(_grants(role, roles))
            if keys
        ]
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [role.name]})
    subjects = [{"id": role.name, "cert_common_names": [role.name]} for role in roles]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _grants(role: Role, roles: Sequence[Role]) -> Iterator[tuple[str, list[str], Sequence[str]]]:
    everyone = ["alive/*/*"]
    if role.name == _RELAY:
        keys = sorted({key for each in roles for key in (*each.says, *each.serves, *each.asks)})
        yield "ingress", ["put", "delete", "declare_subscriber"], keys
        yield "ingress", ["query", "reply", "declare_queryable"], keys
        yield "ingress", ["liveliness_token", *_LIVENESS], everyone
    else:
        yield "ingress", ["put", "delete"], role.says
        yield "ingress", ["declare_subscriber"], role.reads
        yield "ingress", ["query"], role.asks
        yield "ingress", ["reply", "declare_queryable"], role.serves
        yield "ingress", ["liveliness_token"], [role.lives]
        yield "ingress", _LIVENESS, everyone
    yield "egress", ["put", "delete"], role.reads
    # A wish to read `metrics/**` is wider than what any one says: all learn what is read.
    yield "egress", ["declare_subscriber"], sorted({key for each in roles for key in each.reads})
    yield "egress", ["query"], role.serves
    yield "egress", ["reply", "declare_queryable"], role.asks
    yield "egress", ["liveliness_token", *_LIVENESS], everyone


def _rule(name: str, flow: str, messages: list[str], keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": f"{flow} of {name}",
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": list(keys),
    }
