"""Requests as bytes: whatever a handler says or raises, who asked gets a reply that can be read."""

import msgpack
import pytest

from services.mapper.requests import Classify
from services.runtime.command import carry_out, unpack_reply
from services.runtime.errors import CommandFailed

pytestmark = pytest.mark.unit

NAME = "y" * 60_000
PACKED = {"dtype": "<f4", "shape": [0, 3], "data": b""}
KEY = "ctl/mapper/classify"


def reply(handler, params):
    """Return a reply's bytes and what was counted."""
    told = []
    payload = msgpack.packb({"params": params})
    return carry_out(KEY, handler, payload, lambda key, why: told.append((key, why))), told


def refusal(handler, params):
    answer, told = reply(handler, params)
    with pytest.raises(CommandFailed) as error:
        unpack_reply(KEY, answer)
    assert [key for key, _ in told] == [KEY]
    assert "malformed" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    "error",
    [ValueError, TypeError, KeyError, OSError, OverflowError, ZeroDivisionError, MemoryError,
     RecursionError],
)  # fmt: skip
def test_what_a_handler_cannot_do_is_the_reply(error) -> None:
    def handler(_):
        raise error("out of reach")

    assert "out of reach" in refusal(handler, {})


@pytest.mark.parametrize("params", [{NAME: 1}, {"points_m": PACKED | {NAME: 1}}])
def test_a_refusal_stays_short_however_long_a_name_was(params) -> None:
    def handler(given):
        Classify.model_validate(given | {"points_m": given.get("points_m", [])})
        return {}

    assert 4000 < len(refusal(handler, params)) < 4200


def test_a_bug_is_not_hidden() -> None:
    def handler(_):
        raise AttributeError("ours")

    with pytest.raises(AttributeError):
        reply(handler, {})
