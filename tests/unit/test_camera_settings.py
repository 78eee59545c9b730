"""The camera's settings."""

import math

import pytest
from pydantic import ValidationError

from services.camera.settings import CameraSettings
from services.camera.sources.simulated import SimulatedSettings
from services.runtime.service import parse

pytestmark = pytest.mark.unit


def test_flags_reach_the_source_and_the_optics():
    flags = "--camera 3 --noise d4xx --width 320 --height 240 --seed 8 --max-range-m 3 --color"
    settings = parse(CameraSettings, "camera", flags.split())
    assert settings.instance() == "3"
    source = settings.source_settings()
    assert isinstance(source, SimulatedSettings)
    assert (source.camera, source.seed, source.noise, source.max_range_m, source.color) == (
        3, 8, "d4xx", 3.0, True,
    )  # fmt: skip
    optics = source.intrinsics
    assert (optics.width, optics.height, optics.cx, optics.cy) == (320, 240, 159.5, 119.5)
    assert optics.fy == pytest.approx(120 / math.tan(math.radians(22.5)))


def test_the_environment_sets_what_flags_do_not(monkeypatch):
    monkeypatch.setenv("ENCIRCLE_CAMERA_NOISE", "ideal")
    assert parse(CameraSettings, "camera", []).noise == "ideal"
    assert parse(CameraSettings, "camera", ["--noise", "nguyen"]).noise == "nguyen"


def test_a_range_that_the_depth_scale_cannot_hold_is_refused_naming_both():
    with pytest.raises(ValidationError, match=r"max_range_m 5 .*depth_scale_m"):
        CameraSettings(depth_scale_m=0.00001)
