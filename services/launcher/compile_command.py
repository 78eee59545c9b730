"""`encircle compile`: the kernels now, not at the first message."""

import argparse
from collections.abc import Sequence

from services.launcher.warm_up import warm_up


def compile_kernels(args: Sequence[str]) -> int:
    """Have every kernel compiled into numba's cache, or find that it is there."""
    argparse.ArgumentParser(prog="encircle compile", description=__doc__).parse_args(args)
    warm_up(print)
    print("the kernels are compiled")
    return 0
