"""The one door to Open3D, which is heavy, optional and needs a library that it does not ship."""

import ctypes
from functools import cache
from typing import Any

from services.runtime.errors import MissingExtra


@cache
def open3d() -> Any:
    """Import Open3D at its first use.

    Returns:
        The `open3d` module.

    Raises:
        MissingExtra: If Open3D or libusb-package is not installed, or does not load.
    """
    try:
        import libusb_package

        # Open3D's wheel links against libusb-1.0 and relies on the system to have it. Loaded
        # globally beforehand, the loader finds it under its soname.
        ctypes.CDLL(str(libusb_package.get_library_path()), ctypes.RTLD_GLOBAL)
        import open3d as module
    except (ImportError, OSError) as error:
        raise MissingExtra(
            f"the evaluator needs Open3D ({error}): pip install 'encircle[evaluator]'"
        ) from error
    module.utility.set_verbosity_level(module.utility.VerbosityLevel.Error)
    return module
