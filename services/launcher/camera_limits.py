"""What the simulated cameras of a run can see and do: what its formation is held against."""

from typing import TypedDict

from services.launcher.optics import half_view_deg
from services.launcher.settings import RunSettings


class CameraLimits(TypedDict):
    """As the settings of a plan name them."""

    beta_deg: float
    beta_up_deg: float
    target_radius_m: float
    range_min_m: float
    range_max_m: float
    v_max_mps: float
    omega_max_rps: float


def camera_limits(run: RunSettings) -> CameraLimits:
    """Return them; of the target, as much as it is high must be seen."""
    from services.camera.settings import CameraSettings

    camera = CameraSettings()  # As every camera will read them: defaults, then the environment.
    robot = camera.flying if run.drive == "flying" else camera.unicycle
    return {
        "beta_deg": half_view_deg(*run.image_size, run.vfov),
        "beta_up_deg": run.vfov / 2,
        "target_radius_m": run.height / 2,
        "range_min_m": camera.min_range_m,
        "range_max_m": camera.max_range_m,
        "v_max_mps": robot.max_speed_mps,
        "omega_max_rps": robot.max_turn_rps,
    }
