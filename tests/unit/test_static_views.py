"""Standing cameras: a ring in the world, and view files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.kernels.rigid import look_at, planar, pose_error
from services.planner.dome import dome_views
from services.planner.errors import PlannerError, ViewFileError
from services.planner.motion import Motion
from services.planner.strategies.static import Static, StaticSettings
from services.planner.view_file import format_views, parse_views, read_views

pytestmark = pytest.mark.unit

MOVING = Motion(planar(1, 2, 0.3), np.array([0.2, 0, 0]), np.array([0, 0, 0.1]))


def static(cameras=6, view_file=None):
    return Static(
        StaticSettings(
            cameras=cameras,
            radius_m=2.0,
            elevation_rad=0.3,
            centre_m=(0.5, 0.0, 0.2),
            view_file=view_file,
        )
    )


def test_a_static_ring_rests_whatever_the_target_does():
    first, later = static().plan(MOVING, 0.0), static().plan(MOVING.predicted(3.0), 3.0)
    for a, b in zip(first.views, later.views, strict=True):
        np.testing.assert_array_equal(a.T, b.T)
        assert not a.linear.any()
        assert not a.angular.any()


def test_a_static_ring_stands_around_its_own_centre():
    plan = static().plan(MOVING, 0.0)
    eyes = np.array([view.T[:3, 3] for view in plan.views])
    np.testing.assert_allclose(np.linalg.norm(eyes - [0.5, 0, 0.2], axis=1), 2.0)
    np.testing.assert_array_equal(eyes, plan.polygon_m)


def test_a_view_file_gives_one_view_per_camera(tmp_path):
    file = tmp_path / "views.txt"
    file.write_text(format_views(dome_views()))
    views = static(cameras=3, view_file=file).plan(MOVING, 0.0).views
    for have, want in zip(views, dome_views()[:3], strict=True):
        np.testing.assert_allclose(have.T, want, atol=1e-9)


def test_a_view_file_with_too_few_views_says_so(tmp_path):
    file = tmp_path / "views.txt"
    file.write_text(format_views(dome_views()[:2]))
    with pytest.raises(PlannerError, match=r"views\.txt: 2 views for 3 cameras"):
        static(cameras=3, view_file=file)


@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_written_views_are_read_back(seed, num):
    rng = np.random.default_rng(seed)
    views = [look_at(rng.normal(size=3), rng.normal(size=3)) for _ in range(num)]
    for have, want in zip(parse_views(format_views(views)), views, strict=True):
        assert pose_error(have, want) == pytest.approx((0, 0), abs=1e-9)


def test_the_count_is_optional_and_comments_are_skipped():
    line = "1 2 3 0 0 0 1"
    plain = parse_views(f"{line}\n{line}\n")
    counted = parse_views(f"2\n# a comment\n\n{line}  # the first\n{line}\n")
    np.testing.assert_array_equal(plain, counted)
    np.testing.assert_array_equal(plain[0][:3, 3], [1, 2, 3])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no view; each line is"),
        ("1 2 3", "views:1: 3 values; a view is"),
        ("1 2 3 0 0 0 1\n1 2 x 0 0 0 1", "views:2: could not convert string to float: 'x'"),
        ("1 2 3 0 0 0 0", "views:1: quaternion .* norm 0; it must be 1"),
        ("1 2 nan 0 0 0 1", "views:1: .* must be finite"),
        ("3\n1 2 3 0 0 0 1", "the first line says 3 views, there are 1"),
        ("1 2 1e9 0 0 0 1", "views:1: .*less than or equal to 1000000"),
    ],
)
def test_a_bad_view_file_names_line_and_rule(text, complaint):
    with pytest.raises(ViewFileError, match=complaint):
        parse_views(text)


def test_a_missing_view_file_is_named(tmp_path):
    with pytest.raises(ViewFileError, match=r"none\.txt: cannot be read: No such file"):
        read_views(tmp_path / "none.txt")


def test_a_binary_file_is_no_view_file(tmp_path):
    file = tmp_path / "mesh.stl"
    file.write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ViewFileError, match="not a text file"):
        read_views(file)
