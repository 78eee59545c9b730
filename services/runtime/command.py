"""Requests and replies on `ctl/<service>[/<i>]/<verb>`, packed and unpacked."""

from collections.abc import Callable
from typing import Any

import msgpack
from pydantic import ValidationError

from schemas.codec import unpack
from schemas.commands import CommandReply, CommandRequest
from schemas.message import MessageError
from services.runtime.errors import BadCommand, CommandFailed, RuntimeFault

_LONGEST_ERROR = 4096
_REFUSALS = (
    MessageError, RuntimeFault, ValueError, TypeError, KeyError, OSError,
    ArithmeticError, MemoryError, RecursionError,  # Numbers and sizes out of reach.
)  # fmt: skip

Handler = Callable[[dict[str, Any]], dict[str, Any]]


def key(address: str, verb: str) -> str:
    """Return the key of a service's verb."""
    return f"ctl/{address}/{verb}"


def pack_request(params: dict[str, Any]) -> bytes:
    """Pack what is asked."""
    packed: bytes = msgpack.packb(CommandRequest(params=params).model_dump())
    return packed


def unpack_reply(asked_key: str, payload: bytes) -> dict[str, Any]:
    """Return the result of a reply.

    Raises:
        CommandFailed: If the service refused, or its reply is malformed.
    """
    try:
        reply = CommandReply.model_validate(unpack(payload))
    except (MessageError, ValidationError) as error:
        raise CommandFailed(f"{asked_key}: malformed reply: {error}") from None
    if not reply.ok:
        raise CommandFailed(f"{asked_key}: {reply.error}")
    return reply.result


def carry_out(
    asked_key: str, handler: Handler, payload: bytes, refuse: Callable[[str, str], None]
) -> bytes:
    """Run a handler on a request's bytes and pack its reply; an error becomes a clear one.

    Args:
        asked_key: The key of the request. handler: Takes its parameters. payload: Its bytes.
        refuse: Told key and reason of a request that is not carried out.
    """
    try:
        request = CommandRequest.model_validate(unpack(payload) if payload else {})
        reply = CommandReply(ok=True, result=handler(request.params))
    except ValidationError as error:
        reply = CommandReply(ok=False, error=_first_error(error)[:_LONGEST_ERROR])
    except _REFUSALS as error:
        reply = CommandReply(ok=False, error=f"{type(error).__name__}: {error}"[:_LONGEST_ERROR])
    if not reply.ok:
        refuse(asked_key, reply.error)
    packed: bytes = msgpack.packb(reply.model_dump())
    return packed


def only(params: dict[str, Any], *names: str) -> None:
    """Check that a request carries no parameter beyond `names`.

    Raises:
        BadCommand: Naming the unknown parameter and the choices.
    """
    for name in params:
        if name not in names:
            choices = ", ".join(names) or "none"
            raise BadCommand(f"unknown parameter {name!r}; known: {choices}")


def _first_error(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"]) or "request"
    return f"{where}: {first['msg']} (got {first['input']!r:.80})"
