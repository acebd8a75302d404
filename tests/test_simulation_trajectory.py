"""The trajectories of the simulated camera."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from pipeline.geometry import Array
from recorder.simulation.trajectory import AnyTrajectory, RectangleTrajectory, camera_rotation

ADAPTER: TypeAdapter[Any] = TypeAdapter(AnyTrajectory)

RECTANGLE = {
    "kind": "rectangle",
    "looking": "up",
    "centre_m": [1.5, 1.0],
    "width_m": 3.0,
    "height_m": 2.0,
    "z_m": 0.25,
    "speed_mps": 0.5,
    "start": "top_right",
    "direction": "counterclockwise",
}


def rectangle(**changes: object) -> RectangleTrajectory:
    trajectory = ADAPTER.validate_python(RECTANGLE | changes)
    assert isinstance(trajectory, RectangleTrajectory)
    return trajectory


def place(trajectory: RectangleTrajectory, t_s: float) -> Array:
    return trajectory.pose(t_s).translation


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, -135.0, 180.0])
def test_camera_axes(yaw_deg: float) -> None:
    yaw = math.radians(yaw_deg)
    x = [math.cos(yaw), math.sin(yaw), 0]
    for looking, z in (("up", [0, 0, 1]), ("down", [0, 0, -1])):
        rotation = camera_rotation(looking, yaw)  # type: ignore[arg-type]
        np.testing.assert_allclose(rotation[:, 0], x, atol=1e-12)
        np.testing.assert_allclose(rotation[:, 2], z, atol=1e-12)
        np.testing.assert_allclose(rotation[:, 1], np.cross(z, x), atol=1e-12)


@given(
    st.sampled_from(["up", "down"]), st.floats(-3, 3), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)
)
def test_tilts_turn_by_their_angle_and_keep_the_yaw(
    looking: Any, yaw: float, roll: float, pitch: float
) -> None:
    rotation = camera_rotation(looking, yaw, roll, pitch)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert math.atan2(rotation[1, 0], rotation[0, 0]) == pytest.approx(yaw, abs=1e-9)
    up = 1.0 if looking == "up" else -1.0
    assert up * rotation[2, 2] == pytest.approx(math.cos(roll) * math.cos(pitch), abs=1e-12)


def test_rectangle_visits_its_corners_in_order_at_constant_speed() -> None:
    drive = rectangle()
    assert drive.duration_s == pytest.approx(20.0)
    # Top side first, then left, bottom, right.
    for t_s, corner in ((0, (3, 2)), (6, (0, 2)), (10, (0, 0)), (16, (3, 0)), (20, (3, 2))):
        np.testing.assert_allclose(place(drive, t_s), (*corner, 0.25), atol=1e-12)
    times = np.linspace(0, 20, 2001)
    path = np.array([place(drive, t) for t in times])
    way = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert way == pytest.approx(10.0, abs=1e-9)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.005, atol=1e-9)


def test_rectangle_stands_before_and_after() -> None:
    drive = rectangle(dwell_s=2.0)
    for t_s in (-0.1, 0.0, 1.0, 2.0, 22.0, 30.0):
        np.testing.assert_allclose(place(drive, t_s), (3, 2, 0.25), atol=1e-12)
    np.testing.assert_allclose(place(drive, 3.0), (2.5, 2, 0.25), atol=1e-12)
    assert drive.duration_s == pytest.approx(22.0)


def test_clockwise_is_the_other_way_round() -> None:
    drive = rectangle(direction="clockwise", start="top_left")
    np.testing.assert_allclose(place(drive, 6.0), (3, 2, 0.25), atol=1e-12)
    np.testing.assert_allclose(place(drive, 10.0), (3, 0, 0.25), atol=1e-12)


def test_following_yaw_points_ahead() -> None:
    drive = rectangle(yaw_deg="follow")
    for t_s, yaw_deg in ((1.0, 180), (7.0, -90), (12.0, 0), (17.0, 90)):
        assert drive.pose(t_s).yaw_rad == pytest.approx(math.radians(yaw_deg))


def test_waypoints_are_met_and_joined_evenly() -> None:
    points: list[dict[str, Any]] = [
        {"t_s": 1.0, "xyz_m": [0.0, 0.0, 0.2], "yaw_deg": 170},
        {"t_s": 3.0, "xyz_m": [1.0, -1.0, 0.2], "yaw_deg": -170, "roll_deg": 3},
        {"t_s": 4.0, "xyz_m": [1.0, 1.0, 0.4], "yaw_deg": -90, "pitch_deg": -2},
    ]
    drive = ADAPTER.validate_python({"kind": "waypoints", "looking": "up", "points": points})
    for point in points:
        pose = drive.pose(point["t_s"])
        np.testing.assert_allclose(pose.translation, point["xyz_m"], atol=1e-12)
        assert np.degrees(pose.yaw_rad) == pytest.approx(point["yaw_deg"], abs=1e-9)
    middle = drive.pose(2.0)
    np.testing.assert_allclose(middle.translation, (0.5, -0.5, 0.2), atol=1e-12)
    # The short way round, through 180 degrees.
    assert abs(np.degrees(middle.yaw_rad)) == pytest.approx(180.0, abs=0.2)
    np.testing.assert_array_equal(drive.pose(0.0).rotation, drive.pose(1.0).rotation)
    np.testing.assert_allclose(drive.pose(9.0).translation, (1, 1, 0.4), atol=1e-12)
    assert drive.duration_s == 4.0


def test_waypoints_out_of_order_are_refused() -> None:
    points = [{"t_s": 1.0, "xyz_m": [0.0, 0.0, 0.2]}, {"t_s": 1.0, "xyz_m": [1.0, 0.0, 0.2]}]
    with pytest.raises(ValidationError, match="expected increasing t_s"):
        ADAPTER.validate_python({"kind": "waypoints", "looking": "up", "points": points})
