"""Becomes a service whose life hangs on the launcher's: `child.py LAUNCHER_PID PROGRAM ARGS...`.

Run as a script, without site packages, so that it costs 20 ms.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def main() -> None:
    """Ask to be killed when the launcher dies, then become the program."""
    launcher, program = int(sys.argv[1]), sys.argv[2:]
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != launcher:  # It died before we asked.
        sys.exit(f"launcher {launcher} is gone")
    os.execvp(program[0], program)


if __name__ == "__main__":
    main()
