"""Compiles the numba kernels once, here, before a dozen processes would each do it at once."""

import hashlib
import importlib
import time
from collections.abc import Callable
from pathlib import Path

_SERVICES = Path(__file__).parents[1]
_KERNELS = _SERVICES / "kernels"
# Each has a function `warm_up` that runs its kernels on tiny arrays of the types it uses.
_USERS = {
    "the object": "services.world.warm_up",
    "the cameras": "services.camera.warm_up",
    "the mapper": "services.mapper.warm_up",
}


def warm_up(say: Callable[[str], None]) -> None:
    """Have every kernel compiled and cached; nothing is imported when they already are.

    Args:
        say: Shows one line of progress.
    """
    stamp = _stamp()
    if stamp.exists():
        return
    say("compiling kernels; only the first start takes this minute")
    for number, (what, module) in enumerate(_USERS.items(), start=1):
        began_s = time.monotonic()
        importlib.import_module(module).warm_up()
        say(f"  {number}/{len(_USERS)} {what}: {time.monotonic() - began_s:.1f} s")
    try:
        stamp.parent.mkdir(exist_ok=True)
        stamp.touch()
    except OSError:
        return  # A read-only installation caches elsewhere; the next start looks again.


def _stamp() -> Path:
    """Return the file whose presence says that today's kernels are compiled.

    It lies beside numba's cache, to be removed along with it, and its name tells the sources,
    the versions and the processor, as any of them makes numba compile anew.
    """
    import numba
    from llvmlite import binding  # type: ignore[import-untyped]

    sources = [*sorted(_KERNELS.glob("*.py")), *sorted(_SERVICES.glob("*/warm_up.py"))]
    digest = hashlib.sha256(f"{numba.__version__} {binding.get_host_cpu_name()}".encode())
    for source in sources:
        digest.update(source.read_bytes())
    return _KERNELS / "__pycache__" / f"compiled-{digest.hexdigest()[:16]}"
