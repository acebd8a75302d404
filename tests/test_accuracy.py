"""Errors against truth: figures worked out by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geometry import Pose, read_only
from recorder.files.truth_file import StoodPose, Trajectory, Truth, TruthPath
from replay.accuracy import distance_to_path, path_errors, timed_errors
from replay.truth import MeasuredTruth, interpolate

NAN = float("nan")


def test_timed_errors_by_hand() -> None:
    truth = np.array([[0, 0, 0, 3.1], [1, 1, 0, 0], [3, 0, 0, 0]], dtype=float)
    estimate = np.array([[0, 0.03, 0.04, -3.1], [1, 0.97, 0.0, NAN], [2, 9, 9, 9]], dtype=float)
    error = timed_errors(estimate, truth)
    assert error["n"] == 2
    assert error["x_m"]["rmse"] == pytest.approx(0.03)
    assert error["x_m"]["mean"] == pytest.approx(0.0)
    assert error["x_m"]["max"] == pytest.approx(0.03)
    assert error["y_m"]["mean"] == pytest.approx(0.02)
    assert error["position_m"]["max"] == pytest.approx(0.05)
    assert error["position_m"]["median"] == pytest.approx(0.04)
    # Across the wrap at pi the headings are 0.083 rad apart, not 6.2.
    assert error["yaw_rad"]["max"] == pytest.approx(2 * np.pi - 6.2)


def test_errors_without_a_common_frame_are_absent_not_made_up() -> None:
    error = timed_errors(np.array([[0.0, 1, 1, 1]]), np.array([[5.0, 1, 1, 1]]))
    assert error["n"] == 0
    assert error["x_m"]["rmse"] is None
    assert "yaw_rad" not in error


RECTANGLE = TruthPath(read_only([[0, 0], [3, 0], [3, 2], [0, 2]], (-1, 2)), True, 0.05)


@pytest.mark.parametrize(
    ("point", "distance"),
    [((1, 0.2), 0.2), ((1.5, 1.0), 1.0), ((-0.3, -0.4), 0.5), ((0.1, 1.0), 0.1), ((3, 1.3), 0.0)],
)
def test_distance_to_a_closed_path(point: tuple[float, float], distance: float) -> None:
    assert distance_to_path(np.array([point]), RECTANGLE)[0] == pytest.approx(distance, abs=1e-12)


def test_an_open_path_has_no_closing_side() -> None:
    path = TruthPath(RECTANGLE.points_m, False, 0.05)
    assert distance_to_path(np.array([[0.1, 1.0]]), path)[0] == pytest.approx(1.0)


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=20))
def test_distance_agrees_with_a_finely_sampled_path(points: list[tuple[float, float]]) -> None:
    corners = np.vstack([RECTANGLE.points_m, RECTANGLE.points_m[:1]])
    t = np.linspace(0, 1, 2001)[:, None]
    samples = np.vstack([a + t * (b - a) for a, b in pairwise(corners)])
    positions = np.array(points)
    brute = np.linalg.norm(positions[:, None] - samples[None], axis=2).min(axis=1)
    np.testing.assert_allclose(distance_to_path(positions, RECTANGLE), brute, atol=2e-3)


def test_share_in_the_band_counts_its_edge() -> None:
    positions = np.array([[1, 0.05], [1, -0.04], [1, 0.06], [NAN, NAN]])
    error = path_errors(positions, RECTANGLE)
    assert error["n"] == 3
    assert error["share_in_band"] == pytest.approx(2 / 3)
    assert error["max_m"] == pytest.approx(0.06)


def stood(from_s: float, to_s: float) -> StoodPose:
    return StoodPose(from_s, to_s, 1.0, 2.0, None, None, 0.005)


def test_stood_poses_apply_to_the_frames_of_their_span() -> None:
    start_ns = 5_000_000_000
    measured = MeasuredTruth(Truth("map", "", poses=(stood(1.0, 2.0),)), start_ns)
    inside = [bool(list(measured.at(0, start_ns + ms * 10**6))) for ms in (999, 1000, 1500, 2001)]
    assert inside == [False, True, True, False]
    # Both ends belong to the span, also where a product of floats would be an ulp beyond.
    until = MeasuredTruth(Truth("map", "", poses=(stood(0.0, 1.9),)), start_ns)
    inside = [bool(list(until.at(0, start_ns + i * 10**8))) for i in range(21)]
    assert inside == [True] * 20 + [False]
    row = next(measured.at(7, start_ns + 10**9))
    assert (row.frame_index, row.kind, row.position_m[:2], row.std_m) == (
        7,
        "measured",
        (1, 2),
        0.005,
    )
    assert np.isnan(row.yaw_rad)


def trajectory(timed: bool) -> Trajectory:
    turned = Pose.from_rvec_tvec((0, 0, 0.4), (0, 0, 0)).quat_xyzw
    stamps = np.array([0, 10**9, 5 * 10**9]) + 10**18
    return Trajectory(
        frame_index=None if timed else np.array([0, 3, 9]),
        timestamp_ns=stamps if timed else None,
        positions_m=read_only([[0, 0, 0], [1, 2, 0], [9, 9, 0]]),
        # The same rotation may be written with either sign.
        quats_xyzw=read_only(np.array([(0, 0, 0, 1), -turned, (0, 0, 0, 1)])),
    )


def test_a_timed_trajectory_is_interpolated_but_not_across_gaps() -> None:
    samples = trajectory(timed=True)
    middle = interpolate(samples, 10**18 + 500_000_000)
    assert middle is not None
    np.testing.assert_allclose(middle.translation, [0.5, 1.0, 0.0])
    assert middle.yaw_rad == pytest.approx(0.2, abs=1e-6)
    assert interpolate(samples, 10**18 + 2 * 10**9) is None
    assert interpolate(samples, 10**18 - 1) is None
    assert interpolate(samples, 10**18 + 6 * 10**9) is None
    last = interpolate(samples, 10**18 + 5 * 10**9)
    assert last is not None
    np.testing.assert_allclose(last.translation, [9, 9, 0])


def test_a_trajectory_by_frame_applies_to_its_frames_only() -> None:
    measured = MeasuredTruth(Truth(None, "", trajectory=trajectory(timed=False)), 0)
    assert [len(list(measured.at(i, 0))) for i in (0, 1, 3, 9)] == [1, 0, 1, 1]
    assert next(measured.at(3, 0)).yaw_rad == pytest.approx(0.4)
