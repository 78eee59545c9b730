"""Which parts of encircle a run needs, and which of them are not installed."""

from importlib.util import find_spec

from services.launcher.errors import MissingExtraError
from services.launcher.settings import RunSettings

# Packages by extra; an extra may hold more, these are the ones that tell.
_PACKAGES = {
    "simulator": ("pybullet", "trimesh", "scipy"),
    "camera": ("pybullet", "trimesh", "scipy"),
    "evaluator": ("open3d",),
    "report": ("matplotlib",),
}


def check_extras(settings: RunSettings) -> None:
    """See to it that all that a run needs is installed, without importing it.

    Raises:
        MissingExtraError: Naming the packages and the extras to install.
    """
    needed = ["simulator", "camera", "report"] + ["evaluator"] * settings.evaluator
    lacking = {
        extra: missing
        for extra in needed
        if (missing := [name for name in _PACKAGES[extra] if find_spec(name) is None])
    }
    if lacking:
        packages = sorted({name for names in lacking.values() for name in names})
        raise MissingExtraError(
            f"not installed: {', '.join(packages)}; "
            f"pip install 'encircle[{','.join(lacking)}]', or 'encircle[all]'"
        )
