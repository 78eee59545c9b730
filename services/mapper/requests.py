"""What may be asked of a mapper, verb by verb: `ctl/mapper/<verb>`.

Rows of three come as nested lists, at most 4096 (the codec's limit), or packed: `dtype` `<f4` or
`<f8`, `shape` and the little-endian bytes as `data`. Answers come back in the same form. A request,
and its answer, may have 1 MiB: 87,000 points in single precision.
"""

from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, model_validator

from schemas.codec import MAX_PLAIN_BYTES

MAX_FIELD_VOXELS = (MAX_PLAIN_BYTES - 4096) // 4
"""Voxels of a distance field that fit an answer, in single precision."""
MAX_LOOKED_AT = 1 << 22
"""Voxels that a field is computed from, its margin included: half a second without fusing."""
MAX_LISTED = 4096
"""Rows that an answer lists."""

Frame = Literal["map", "world"]


class Packed(BaseModel):
    """An array as bytes."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dtype: Literal["<f4", "<f8"]
    shape: tuple[Annotated[int, Field(ge=0)], Literal[3]]
    data: bytes

    @model_validator(mode="after")
    def _bytes_agree(self) -> Self:
        wanted = self.shape[0] * 3 * np.dtype(self.dtype).itemsize
        if len(self.data) != wanted:
            raise ValueError(
                f"shape {self.shape} {self.dtype} needs {wanted} bytes, got {len(self.data)}"
            )
        return self


class Rows(NamedTuple):
    """Points or directions, and how they came."""

    array: NDArray[np.float64]
    """(N, 3)"""
    packed: bool

    def answer(self, array: NDArray[Any]) -> Any:
        """Return an answer's array in the form in which the question came."""
        return packed(array) if self.packed else array.tolist()


def packed(array: NDArray[Any]) -> dict[str, Any]:
    """Return an array as its type, shape and little-endian bytes; reals in single precision."""
    kind = "<f4" if array.dtype.kind == "f" else array.dtype.newbyteorder("<")
    small = np.ascontiguousarray(array, kind)
    return {"dtype": small.dtype.str, "shape": list(small.shape), "data": small.tobytes()}


def _rows(value: Any) -> Rows:
    if isinstance(value, dict):
        try:
            given = Packed.model_validate(value)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
        array = np.frombuffer(given.data, given.dtype).reshape(given.shape)
        return Rows(array.astype(np.float64), packed=True)
    try:
        array = np.array(value if isinstance(value, list | tuple) else [value], np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"must be numbers of shape (N, 3): {error}") from None
    if array.size == 0:
        array = array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3 or len(array) > MAX_LISTED:
        raise ValueError(
            f"has shape {array.shape}; it must be (N, 3), N at most {MAX_LISTED}, or packed as "
            "{dtype: '<f4' or '<f8', shape: [N, 3], data: bytes}"
        )
    return Rows(array, packed=False)


RowsOfThree = Annotated[Rows, PlainValidator(_rows)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Corner = tuple[Number, Number, Number]
Reach = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
FilePath = Annotated[str, Field(min_length=1, max_length=4096)]


class Request(BaseModel):
    """What every verb's parameters have in common."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Classify(Request):
    """Which class is the voxel of each point? 0 unknown, 1 free, 2 occupied."""

    points_m: RowsOfThree
    frame: Frame = "map"


class CastRays(Request):
    """What does each ray meet first?"""

    origins_m: RowsOfThree
    directions: RowsOfThree
    max_range_m: Reach | None = None
    """None: to the end of the box."""
    unknown_stops: bool = False
    frame: Frame = "map"


class Distance(Request):
    """How far is the nearest occupied voxel: of points, or of all voxels within bounds?"""

    points_m: RowsOfThree | None = None
    bounds_m: tuple[Corner, Corner] | None = None
    reach_m: Reach = 1.0
    unknown_is: Literal["free", "occupied"] = "free"
    frame: Frame = "map"

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.points_m is None) == (self.bounds_m is None):
            raise ValueError("points_m or bounds_m must be given, and not both")
        if self.bounds_m is not None and self.frame == "world":
            raise ValueError("bounds_m are a box in frame 'map'; in 'world' ask by points_m")
        return self


class Entropy(Request):
    """How many bits are not known of the box, or of the part within bounds (frame map)?"""

    bounds_m: tuple[Corner, Corner] | None = None


class Save(Request):
    """Write the map; the name's ending says in which format."""

    path: FilePath


class Load(Request):
    """Go on with a map from a file."""

    path: FilePath


class Get(Request):
    """What is the map, and what does it hold? Also in the middle of an instant."""


class Reset(Request):
    """Forget the map; the next changes tell."""


VERBS: dict[str, type[Request]] = {
    "cast_rays": CastRays,
    "classify": Classify,
    "distance": Distance,
    "entropy": Entropy,
    "get": Get,
    "load": Load,
    "reset": Reset,
    "save": Save,
}
"""The verbs; `set` besides, whose parameters are the fields of `MemorySettings`."""
