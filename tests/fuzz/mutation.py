"""Messages gone wrong: seeded, so that each can be made again from its number."""

import math
from typing import Any, NamedTuple

import msgpack
import numpy as np

ODD: tuple[Any, ...] = (
    None, True, False, "", "x", "\u202e\x00", "x" * 300, "x" * 70_000, b"", b"\x00\xff",
    b"x" * 5000,
    0, -1, 1, 2, 3, 63, 64, 127, 255, 2**15, 2**31 - 1, 2**31, 2**53, 2**62, 2**63 - 1, 2**63,
    2**64 - 1, -(2**63), 0.0, -0.0, 0.5, -1.5, 1e-300, 5e-324, 1e6, -1e6, 1e30, 1e308, math.nan,
    math.inf, -math.inf, [], {}, [0], [0] * 3, [0] * 5000, [1e308] * 4, {"": 0}, [[[[[]]]]],
    "world", "target", "persistent", "lockstep", "realtime", "../../etc/passwd", "bunny", "sphere",
)  # fmt: skip
"""What stands in the place of a value."""
_CLAIMS = (
    *(head + b"\xff\xff\xff\xff" for head in (b"\xdf", b"\xdd", b"\xc6", b"\xdb", b"\xc9")),
    b"\xdc\xff\xff", b"\xde\xff\xff", b"\x91" * 3000, b"\x81\xa1a" * 1500,
)  # fmt: skip
"""Headers that promise gigabytes, or nest without end."""


class Mutant(NamedTuple):
    """A payload, and what was done to it."""

    payload: bytes
    how: str
    is_bad: bool
    """It cannot be valid, whatever the reader thinks."""


class Mutator:
    """Draws mutants of valid payloads."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def number(self, below: int) -> int:
        """Return 0 <= n < below."""
        return int(self._rng.integers(below))

    def pick(self, choices: Any) -> Any:
        """Return one of a sequence."""
        return choices[self.number(len(choices))]

    def mutant(self, payload: bytes) -> Mutant:
        """Return a changed payload: half of them by their bytes, half by their fields."""
        how = self.pick(
            ("flip", "cut", "grow", "claim", "splice", "noise", *("value",) * 5, "lack", "version",
             "nan", "twice")
        )  # fmt: skip
        made: Mutant = getattr(self, f"_{how}")(payload)
        return made

    def retold(self, payload: bytes) -> bytes:
        """Return a valid payload of another instant: a sender that restarts, replays, leaps."""
        fields = msgpack.unpackb(payload)
        newest = 2**63 - 1
        fields["tick"] = self.pick((0, 1, 29, 30, 31, 32, 2**31, 2**62, newest))
        fields["t_ns"] = self.pick((0, 1, 2_000_000_000, 2**62, newest, fields["tick"]))
        fields["seq"] = self.pick((0, 1, 40, 41, 42, 2**32, 2**64 - 1))
        fields["boot"] = self.pick(("5e1f", "a", "b"))
        for name in ("rev", "base_rev"):
            if name in fields and self.number(2):
                fields[name] = self.pick((0, 1, 7, 8, 9, 2**64 - 1))
        return packed(fields)

    def _flip(self, payload: bytes) -> Mutant:
        changed = bytearray(payload)
        for _ in range(1 + self.number(4)):
            changed[self.number(len(changed))] ^= 1 << self.number(8)
        return Mutant(bytes(changed), "flip", is_bad=False)

    def _cut(self, payload: bytes) -> Mutant:
        return Mutant(payload[: self.number(len(payload))], "cut", is_bad=True)

    def _grow(self, payload: bytes) -> Mutant:
        more = self._rng.bytes(1 + self.number(64))
        return Mutant(payload + more, "grow", is_bad=True)

    def _claim(self, payload: bytes) -> Mutant:
        at = self.number(len(payload))
        return Mutant(payload[:at] + self.pick(_CLAIMS) + payload[at:], "claim", is_bad=False)

    def _splice(self, payload: bytes) -> Mutant:
        i, j = sorted((self.number(len(payload)), self.number(len(payload))))
        return Mutant(payload[:j] + payload[i:], "splice", is_bad=False)

    def _noise(self, payload: bytes) -> Mutant:
        return Mutant(self._rng.bytes(self.number(2 * len(payload))), "noise", is_bad=False)

    def _value(self, payload: bytes) -> Mutant:
        fields = msgpack.unpackb(payload)
        holder, key = self.pick(places(fields))
        holder[key] = self._other(holder[key])
        return Mutant(packed(fields), f"value {key}", is_bad=False)

    def _other(self, value: Any) -> Any:
        if isinstance(value, int | float) and not isinstance(value, bool) and self.number(2):
            near = (-value, value + 1, value - 1, value * 2, value / 3, value * 1e6, float(value))
            new = self.pick(near)
            return new if isinstance(new, float) or -(2**63) <= new < 2**64 else 0
        if isinstance(value, bytes) and self.number(2):
            return self._rng.bytes(len(value))
        return self.pick(ODD)

    def _lack(self, payload: bytes) -> Mutant:
        fields = msgpack.unpackb(payload)
        name = self.pick(("v", "seq", "src", "boot", "t_pub_ns", "t_ns", "tick", "frame_id"))
        needed = fields.pop(name, None) is not None and name != "v"
        return Mutant(packed(fields), f"lack {name}", is_bad=needed)

    def _version(self, payload: bytes) -> Mutant:
        fields = msgpack.unpackb(payload)
        fields["v"] = self.pick((0, 2, -1, 255, 2**63, "1", None, [1], 1.5))
        return Mutant(packed(fields), "version", is_bad=True)

    def _nan(self, payload: bytes) -> Mutant:
        fields = msgpack.unpackb(payload)
        numbers = [
            (holder, key) for holder, key in places(fields) if isinstance(holder[key], float)
        ]
        if not numbers:
            return self._version(payload)
        holder, key = self.pick(numbers)
        holder[key] = self.pick((math.nan, math.inf, -math.inf))
        return Mutant(packed(fields), "nan", is_bad=True)

    def _twice(self, payload: bytes) -> Mutant:
        fields = msgpack.unpackb(payload)
        pairs = list(fields.items())
        pairs.insert(self.number(len(pairs)), self.pick(pairs))
        packer = msgpack.Packer(autoreset=False)
        packer.pack_map_header(len(pairs))
        for key, value in pairs:
            packer.pack(key)
            packer.pack(value)
        return Mutant(packer.bytes(), "twice", is_bad=True)


def packed(fields: Any) -> bytes:
    """Return msgpack bytes."""
    made: bytes = msgpack.packb(fields)
    return made


def places(value: Any) -> list[tuple[Any, Any]]:
    """Return every (container, key) within nested dicts and lists."""
    found = []
    items = (
        value.items() if isinstance(value, dict)
        else enumerate(value) if isinstance(value, list) else ()
    )  # fmt: skip
    for key, inner in list(items):
        found.append((value, key))
        found.extend(places(inner))
    return found
