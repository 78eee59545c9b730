"""The base of every message, its envelope, and the array that may ride behind it."""

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetPydanticSchema,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import core_schema

SCHEMA_VERSION: Literal[1] = 1

UInt64 = Annotated[int, Field(ge=0, lt=2**64)]
Nanoseconds = Annotated[int, Field(ge=0, lt=2**63)]
Tick = Annotated[int, Field(ge=0, lt=2**63)]
Name = Annotated[str, Field(min_length=1, max_length=64)]


class MessageError(ValueError):
    """What arrived is not a message of ours; the text says what was wrong."""


def _is_buffer(value: Any) -> bytes | bytearray | memoryview:
    if not isinstance(value, bytes | bytearray | memoryview):
        raise ValueError(f"data is {type(value).__name__}; it must be bytes, bytearray, memoryview")
    return value


# pydantic's own `bytes` would copy a memoryview; clouds must pass through untouched.
Buffer = Annotated[
    bytes | bytearray | memoryview,
    GetPydanticSchema(lambda _, __: core_schema.no_info_plain_validator_function(_is_buffer)),
    WithJsonSchema({"type": "string", "contentEncoding": "base64"}),
]


class Envelope(BaseModel):
    """What the bus adds to a message: who sent it, the how-manieth, and when."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    v: Literal[1] = SCHEMA_VERSION
    seq: UInt64
    """Counts up per key from 0; a gap is a lost message."""
    src: Name
    """`service/instance` of the sender."""
    boot: Name
    """Random per process: a new one is a restart, not a loss."""
    t_pub_ns: Nanoseconds
    """Wall clock of the sender when it published."""


class Message(BaseModel):
    """A fact, stamped with the time it was measured at."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    t_ns: Nanoseconds
    """When it was measured; simulated time when simulating."""
    tick: Tick
    """The instant it belongs to: t = tick * dt."""
    frame_id: Name
    """The frame its numbers are in."""


class ArrayLayout(NamedTuple):
    """What the array of a message must look like."""

    dtype: str
    shape: tuple[int | None, ...]
    """None is a free dimension."""
    max_bytes: int


class ArrayMessage(Message):
    """A message with one large array, which travels last and is never copied on decode.

    `shape`, `dtype` and `data` must agree with each other and with the class's `LAYOUT`.
    """

    LAYOUT: ClassVar[ArrayLayout]

    shape: Annotated[tuple[Annotated[int, Field(ge=0, lt=2**31)], ...], Field(max_length=4)]
    dtype: Annotated[str, Field(max_length=8)]
    data: Buffer

    @model_validator(mode="after")
    def _array_agrees(self) -> Self:
        layout = type(self).LAYOUT
        if self.dtype != layout.dtype:
            raise ValueError(f"dtype {self.dtype!r} must be {layout.dtype!r}")
        fits = len(self.shape) == len(layout.shape) and all(
            want is None or want == have
            for want, have in zip(layout.shape, self.shape, strict=True)
        )
        if not fits:
            raise ValueError(f"shape {self.shape} must fit {layout.shape} (None is free)")
        num_bytes = math.prod(self.shape) * np.dtype(layout.dtype).itemsize
        if num_bytes > layout.max_bytes:
            raise ValueError(f"array of {num_bytes} bytes exceeds the limit {layout.max_bytes}")
        have = self.data.nbytes if isinstance(self.data, memoryview) else len(self.data)
        if have != num_bytes:
            raise ValueError(f"shape {self.shape} {self.dtype} needs {num_bytes} bytes, got {have}")
        return self

    @classmethod
    def of(cls, array: NDArray[Any], **fields: Any) -> Self:
        """Build a message around `array` without copying it when it is contiguous.

        An array that spans a whole `bytearray` reaches shared memory with a single copy.

        Raises:
            pydantic.ValidationError: If the array does not fit the class's `LAYOUT`.
        """
        array = np.ascontiguousarray(array)
        data: bytes | bytearray | memoryview | None = _whole_bytearray(array)
        if data is None:
            data = array.reshape(-1).view(np.uint8).data if array.size else b""
        return cls(shape=array.shape, dtype=array.dtype.str, data=data, **fields)

    @property
    def array(self) -> NDArray[Any]:
        """The array, a view of the received bytes (read-only when they came from the bus)."""
        if not math.prod(self.shape):
            return np.empty(self.shape, self.dtype)
        return np.frombuffer(self.data, self.dtype).reshape(self.shape)


def _whole_bytearray(array: NDArray[Any]) -> bytearray | None:
    """Return the bytearray that the array covers wholly; only those fit zenoh's shared memory."""
    base: object = array
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    return base if isinstance(base, bytearray) and len(base) == array.nbytes else None
