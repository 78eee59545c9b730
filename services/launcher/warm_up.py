"""Compiles the numba kernels once, here, before a dozen processes would each do it at once."""

import hashlib
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

_SERVICES = Path(__file__).parents[1]
_KERNELS = _SERVICES / "kernels"


def _object() -> None:
    from services.world.warm_up import warm_up

    warm_up()


def _cameras() -> None:
    from services.camera.warm_up import warm_up

    warm_up()


def _mapper() -> None:
    from services.mapper.warm_up import warm_up

    warm_up()


def _planner() -> None:
    from services.planner.warm_up import warm_up

    warm_up()


# Each runs the kernels of a service on tiny arrays of the types it uses.
_USERS = {"object": _object, "cameras": _cameras, "mapper": _mapper, "planner": _planner}


def warm_up(say: Callable[[str], None]) -> None:
    """Have every kernel compiled and cached; nothing is imported when they already are.

    Args:
        say: Shows one line of progress.
    """
    stamp = _stamp()
    if stamp.exists():
        return
    say("compiling kernels; only the first start takes this minute")
    for number, (what, run) in enumerate(_USERS.items(), start=1):
        began_s = time.monotonic()
        run()
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
    sources = [*sorted(_KERNELS.glob("*.py")), *sorted(_SERVICES.glob("*/warm_up.py"))]
    digest = hashlib.sha256(f"{version('numba')} {sys.version} {_processor()}".encode())
    for source in sources:
        digest.update(source.read_bytes())
    return _KERNELS / "__pycache__" / f"compiled-{digest.hexdigest()[:16]}"


def _processor() -> str:
    """Return what tells this processor from others, without numba: that alone takes 0.5 s."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return " ".join(sorted({line for line in lines if line.startswith(("model name", "flags"))}))
