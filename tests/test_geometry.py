"""Transforms: products, inverses, quaternions, angles."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.geometry import Pose, wrap_angle

finite = st.floats(-10, 10, allow_nan=False)
quaternions = arrays(np.float64, 4, elements=finite).filter(lambda q: np.linalg.norm(q) > 1e-3)
vectors = arrays(np.float64, 3, elements=finite)


@given(quaternions, vectors, quaternions, vectors, arrays(np.float64, (5, 3), elements=finite))
def test_products_and_inverses_act_on_many_points(q1, t1, q2, t2, points):  # type: ignore[no-untyped-def]
    T_a_b, T_b_c = Pose.from_quat(t1, q1), Pose.from_quat(t2, q2)
    np.testing.assert_allclose(
        (T_a_b @ T_b_c).apply(points), T_a_b.apply(T_b_c.apply(points)), atol=1e-9
    )
    np.testing.assert_allclose(T_a_b.inverse().apply(T_a_b.apply(points)), points, atol=1e-9)


@given(quaternions)
def test_quaternion_round_trip_up_to_sign(quaternion):  # type: ignore[no-untyped-def]
    unit = quaternion / np.linalg.norm(quaternion)
    back = Pose.from_quat(np.zeros(3), quaternion).quat_xyzw
    assert back[3] >= 0
    assert min(np.abs(back - unit).max(), np.abs(back + unit).max()) < 1e-9


@given(arrays(np.float64, 3, elements=st.floats(-3, 3)))
def test_rotation_agrees_with_opencv(rvec):  # type: ignore[no-untyped-def]
    pose = Pose.from_rvec_tvec(rvec, np.zeros(3))
    np.testing.assert_allclose(pose.rotation, cv2.Rodrigues(rvec)[0], atol=1e-12)
    again = Pose.from_quat(np.zeros(3), pose.quat_xyzw)
    np.testing.assert_allclose(again.rotation, pose.rotation, atol=1e-9)


@given(st.floats(-100, 100), st.integers(-5, 5))
def test_wrapped_angles_are_in_the_half_open_interval(angle, turns):  # type: ignore[no-untyped-def]
    wrapped = float(wrap_angle(angle + 2 * np.pi * turns))
    assert -np.pi < wrapped <= np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)


def test_minus_pi_wraps_to_pi() -> None:
    assert wrap_angle(-np.pi) == np.pi
    assert wrap_angle(np.pi) == np.pi


def test_yaw_is_the_heading_of_the_x_axis() -> None:
    pose = Pose(cv2.Rodrigues(np.array([0, 0, 2.0]))[0], np.zeros(3))  # type: ignore[arg-type]
    assert pose.yaw_rad == pytest.approx(2.0)
    # Looking down keeps the x axis, so it keeps the heading.
    down = Pose(pose.rotation @ np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    assert down.yaw_rad == pytest.approx(2.0)


def test_values_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Pose.identity().translation[0] = 1.0


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (np.nan, 0, 0, 1), (0, 0, 1)])
def test_no_rotation_from_a_quaternion_without_length(quaternion: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="quaternion"):
        Pose.from_quat((0, 0, 0), quaternion)
