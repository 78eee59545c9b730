"""Prints what pyproject.toml asks for, by extras: so that images keep it when only we change.

`python requirements.py mesh queries` prints the requirements of the two; without a name those of
the core.
"""

import platform
import sys
import tomllib
from pathlib import Path

_LEANER = {"x86_64": {"open3d": "open3d-cpu"}}
"""By processor: the same module without its second copy for CUDA, which is half a gigabyte."""


def main(extras: list[str]) -> None:
    """Print one requirement per line."""
    project = tomllib.loads(Path("pyproject.toml").read_text())["project"]
    for extra in extras:
        if extra not in project["optional-dependencies"]:
            sys.exit(f"no extra {extra!r}; known: {', '.join(project['optional-dependencies'])}")
    asked = [each for extra in extras for each in project["optional-dependencies"][extra]]
    sys.stdout.write("\n".join(map(_lean, asked or project["dependencies"])) + "\n")


def _lean(requirement: str) -> str:
    for name, leaner in _LEANER.get(platform.machine(), {}).items():
        if requirement.startswith(f"{name}>"):
            return leaner + requirement.removeprefix(name)
    return requirement


if __name__ == "__main__":
    main(sys.argv[1:])
