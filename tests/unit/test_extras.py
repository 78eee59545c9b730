"""What is not installed is named together with what to install."""

import pytest

from services.launcher.errors import MissingExtraError
from services.launcher.extras import check_extras
from services.launcher.settings import RunSettings

pytestmark = pytest.mark.unit


def test_all_that_a_run_needs_is_installed_here():
    check_extras(RunSettings())


def test_a_missing_package_is_answered_with_its_extra():
    with pytest.raises(MissingExtraError, match=r"open3d; pip install 'encircle\[evaluator\]'"):
        check_extras(RunSettings(), lambda package: package != "open3d")


def test_what_is_not_used_is_not_asked_for():
    check_extras(RunSettings(evaluator=False), lambda package: package != "open3d")


def test_a_package_of_two_extras_names_both():
    with pytest.raises(MissingExtraError, match=r"pybullet; .*encircle\[simulator,camera\]"):
        check_extras(RunSettings(), lambda package: package != "pybullet")
