"""Timed trajectories of which not everything is known, or that are not in order."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.geometry import Pose
from recorder.errors import InputError
from recorder.files.trajectory_file import Trajectory
from recorder.files.truth_file import Truth, parse_truth
from recorder.log.reader import LogReader
from replay.inputs import Overrides
from replay.run import ReplayOptions, replay
from replay.truth import MeasuredTruth, interpolate
from tests import worlds

CSV = Path("t.csv")


def trajectory(text: str, path: Path = CSV) -> Trajectory:
    found = parse_truth(text.encode(), path).trajectory
    assert found is not None
    return found


def test_x_and_y_are_enough() -> None:
    found = trajectory("frame_index,x_m,y_m\n0,1,2\n1,3,4\n")
    np.testing.assert_array_equal(found.positions_m[:, :2], [[1, 2], [3, 4]])
    assert np.isnan(found.positions_m[:, 2]).all()
    assert np.isnan(found.quats_xyzw).all()
    row = next(MeasuredTruth(Truth(None, "", trajectory=found), 0).at(1, 0))
    assert row.position_m[:2] == (3, 4)
    assert np.isnan([row.position_m[2], *row.quat_xyzw, row.yaw_rad]).all()


@pytest.mark.parametrize(
    ("column", "values"), [("yaw_deg", (170, -170)), ("yaw_rad", np.radians((170, -170)))]
)
def test_headings_alone_go_the_shorter_way_round(column: str, values: tuple[float, float]) -> None:
    a, b = values
    found = trajectory(f"timestamp_ns,x_m,y_m,{column}\n0,0,0,{a}\n1000000000,1,2,{b}\n")
    middle = interpolate(found, 500_000_000)
    assert middle is not None
    np.testing.assert_allclose(middle.translation[:2], [0.5, 1.0])
    assert abs(middle.yaw_rad) == pytest.approx(math.pi)
    quarter = interpolate(found, 250_000_000)
    assert quarter is not None
    assert quarter.yaw_rad == pytest.approx(math.radians(175))
    assert np.isnan(middle.quat_xyzw).all()


def test_an_empty_cell_says_nothing() -> None:
    found = trajectory("frame_index,x_m,y_m,z_m,yaw_deg\n0,1,2,0.5,90\n1,3,4,,\n")
    assert found.yaw_rad(0) == pytest.approx(math.pi / 2)
    assert math.isnan(found.yaw_rad(1))
    np.testing.assert_array_equal(np.isnan(found.positions_m[:, 2]), [False, True])
    # For viewers, what is not known is level and at 0.
    np.testing.assert_allclose(found.pose_to_draw(0).translation, [1, 2, 0.5])
    assert found.pose_to_draw(0).yaw_rad == pytest.approx(math.pi / 2)
    np.testing.assert_array_equal(found.pose_to_draw(1).translation, [3, 4, 0])


def test_a_quaternion_says_more_than_a_heading() -> None:
    turned = Pose.from_rvec_tvec((0, 0, 0.4), (0, 0, 0)).quat_xyzw
    numbers = ",".join(map(repr, turned.tolist()))
    found = trajectory(f"frame_index,x_m,y_m,yaw_deg,qx,qy,qz,qw\n0,1,2,99,{numbers}\n")
    assert found.yaw_rad(0) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("frame_index,x_m\n0,1\n", "x_m, y_m"),
        ("x_m,y_m\n0,1\n", "frame_index or timestamp_ns"),
        ("frame_index,x_m,y_m,qx,qy\n0,1,2,0,0\n", "qx, qy, qz, qw"),
        ("frame_index,x_m,y_m\n0,1,\n", "line 2"),
        ("frame_index,x_m,y_m,z_m\n0,1,2,nan\n", "'nan'"),
    ],
)
def test_mistakes_are_named(text: str, words: str) -> None:
    with pytest.raises(InputError, match=r"t\.csv: ") as error:
        parse_truth(text.encode(), CSV)
    assert words in str(error.value)


def test_a_file_that_is_not_in_order_says_where() -> None:
    pose = "1 2 3 0 0 0 1"
    assert trajectory(f"0 {pose}\n1 {pose}\n", Path("t.tum")).unsorted_at is None
    unsorted = trajectory(f"0 {pose}\n2 {pose}\n# x\n1 {pose}\n", Path("t.tum"))
    assert unsorted.unsorted_at == "line 4"
    assert unsorted.timestamp_ns is not None
    assert unsorted.timestamp_ns.tolist() == [0, 10**9, 2 * 10**9]
    assert trajectory("frame_index,x_m,y_m\n1,0,0\n0,0,0\n").unsorted_at == "line 3"


@pytest.mark.parametrize("rrd", [False, True])
def test_a_replay_takes_what_is_known_and_tells_of_the_order(tmp_path: Path, rrd: bool) -> None:
    log = worlds.small_log(tmp_path / "x.mcap", 5, exact=False)
    truth = tmp_path / "truth.csv"
    truth.write_text("frame_index,x_m,y_m\n0,-0.3,0.1\n2,-0.26,0.1\n1,-0.28,0.1\n")
    options = ReplayOptions(overrides=Overrides(truth=truth), rrd=rrd, progress=False)
    summary = replay(log, tmp_path / "r", "r", options)
    assert summary["truth_problems"] == [
        "the truth's poses are not in order of time from line 4 on: sorted"
    ]
    assert summary["errors"]["measured"]["fixes"]["n"] == 3
    assert summary["errors"]["measured"]["fixes"]["position_m"]["max"] < 0.02
    assert "yaw_rad" not in summary["errors"]["measured"]["fixes"]


def test_a_log_takes_a_trajectory_of_x_and_y(tmp_path: Path) -> None:
    from recorder.attach import attach

    log = worlds.small_log(tmp_path / "x.mcap", 5, exact=False)
    data = b"frame_index,x_m,y_m,yaw_deg\n0,-0.3,0.1,90\n3,-0.26,0.1,\n"
    attach(log, tmp_path / "y.mcap", {"truth.csv": data})
    with LogReader(tmp_path / "y.mcap") as copy:
        topics = [channel.topic for _, channel, _ in copy.messages()]
        truth = copy.truth()
    assert topics.count("/truth/pose") == 2
    assert topics.count("/truth/path") == 1
    assert truth is not None
    assert truth.trajectory is not None
