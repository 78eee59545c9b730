"""What a figure was measured on; every benchmark prints it first."""

import os
import platform
from importlib.metadata import version
from pathlib import Path


def describe(*packages: str) -> str:
    """Return one line: processor, cores, load, Python, and the packages that matter."""
    cpu = "unknown processor"
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            cpu = line.split(":", 1)[1].strip()
            break
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    load = os.getloadavg()[0]
    cores = len(os.sched_getaffinity(0))
    return f"{cpu}, {cores} cores, load {load:.1f}, Python {platform.python_version()}; {versions}"
