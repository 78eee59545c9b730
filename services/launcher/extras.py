"""Which parts of encircle a run needs, and which of them are not installed."""

from collections.abc import Callable
from importlib.util import find_spec

from services.launcher.errors import MissingExtraError
from services.launcher.settings import RunSettings

# Packages by extra; an extra may hold more, these are the ones that tell.
_PACKAGES = {
    "simulator": ("pybullet", "trimesh", "scipy"),
    "camera": ("pybullet", "trimesh", "scipy"),
    "evaluator": ("open3d",),
    "report": ("matplotlib",),
    "recorder": ("mcap", "lz4"),
    "viewer": ("viser", "PIL", "scipy"),
    "export": ("mcap", "lz4", "mcap_protobuf", "foxglove_schemas_protobuf", "av", "PIL"),
}


def is_installed(package: str) -> bool:
    """Whether a package can be imported, without importing it."""
    return find_spec(package) is not None


def lacking_for_viewer(installed: Callable[[str], bool] = is_installed) -> list[str]:
    """Return the packages that the viewer needs and that are not installed."""
    return [name for name in _PACKAGES["viewer"] if not installed(name)]


def check_extras(settings: RunSettings, installed: Callable[[str], bool] = is_installed) -> None:
    """See to it that all that a run needs is installed.

    Raises:
        MissingExtraError: Naming the packages and the extras to install.
    """
    needed = ["simulator", "camera", "report"] + ["evaluator"] * settings.evaluator
    needed += ["recorder"] * (settings.record is not None)
    lacking = {
        extra: missing
        for extra in needed
        if (missing := [name for name in _PACKAGES[extra] if not installed(name)])
    }
    if lacking:
        packages = sorted({name for names in lacking.values() for name in names})
        raise MissingExtraError(
            f"not installed: {', '.join(packages)}; "
            f"pip install 'encircle[{','.join(lacking)}]', or 'encircle[all]'"
        )


def check_installed(extra: str, installed: Callable[[str], bool] = is_installed) -> None:
    """See to it that all packages of an extra are installed.

    Raises:
        MissingExtraError: Naming the packages and the extra to install.
    """
    missing = [name for name in _PACKAGES[extra] if not installed(name)]
    if missing:
        raise MissingExtraError(
            f"not installed: {', '.join(missing)}; pip install 'encircle[{extra}]'"
        )
