"""Coverage-guided fuzzing of what reads foreign bytes: the codec and the map files.

    pip install atheris && python -m tests.fuzz.guided codec -runs=200000 -max_len=4096 corpus/

Atheris has no place among the tests' packages: its instrumentation is for this process alone.
"""

import importlib
import pkgutil
import sys
from collections.abc import Callable

import atheris

import services.kernels

for module in pkgutil.iter_modules(services.kernels.__path__):
    # Before the rest: numba cannot compile what is instrumented.
    importlib.import_module(f"services.kernels.{module.name}")

with atheris.instrument_imports(include=["schemas", "services"]):
    from schemas.codec import decode
    from schemas.message import MessageError
    from schemas.topics import TOPICS
    from services.mapper import npz_file, octree_file, ply_file
    from services.mapper.errors import MapperError
    from services.planner.errors import ViewFileError
    from services.planner.view_file import parse_views


def codec(data: bytes) -> None:
    """The first byte chooses the topic."""
    topic = TOPICS[data[0] % len(TOPICS)] if data else TOPICS[0]
    try:
        decode(topic.adapter, data[1:])
    except MessageError:
        return


def maps(data: bytes) -> None:
    """The first byte chooses the format."""
    readers: tuple[Callable[[bytes], object], ...] = (
        npz_file.read_npz, octree_file.read_bt, octree_file.read_ot, ply_file.read_ply,
    )  # fmt: skip
    try:
        readers[data[0] % len(readers) if data else 0](data[1:])
    except MapperError:
        return


def views(data: bytes) -> None:
    """View files are text."""
    try:
        parse_views(data.decode("utf-8", errors="replace"))
    except ViewFileError:
        return


TARGETS = {"codec": codec, "maps": maps, "views": views}

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in TARGETS:
        sys.exit(f"say what to fuzz: {', '.join(TARGETS)}")
    chosen = TARGETS[sys.argv.pop(1)]
    atheris.Setup(sys.argv, chosen)
    atheris.Fuzz()
