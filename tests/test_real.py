"""Real frames: recorded and replayed as a user would, against measured truth."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from recorder.attachments import read_attachments
from recorder.record import record
from recorder.sources.opening import open_source
from replay.result import open_result
from replay.run import ReplayOptions, replay

QUIET = ReplayOptions(rrd=False, progress=False)


@pytest.mark.parametrize("number", range(4))
def test_moving_board(number: int, shared_data: Path, tmp_path: Path) -> None:
    """A ChArUco board moved before a calibrated camera; truth is from three other cameras."""
    folder = shared_data / "moving_board" / f"cam_{number}"
    files = read_attachments(folder / "camera.yaml", folder / "map.yaml", folder / "truth.csv")
    record(open_source(str(folder / "video.mp4")), tmp_path / "a.mcap", attachments=files)
    summary = replay(tmp_path / "a.mcap", tmp_path / "r", "r", QUIET)
    assert summary["frames"] == 57

    poses = open_result(tmp_path / "r").table("poses")
    four = poses[poses["n_used"] >= 4]
    share = float((four["status"] == "ok").mean())
    truth = open_result(tmp_path / "r").table("truth")
    joined = poses[poses["status"] == "ok"].merge(truth, on="frame_index", suffixes=("", "_true"))
    axes = ["x_m", "y_m", "z_m"]
    error = joined[axes].to_numpy() - joined[[f"{axis}_true" for axis in axes]].to_numpy()
    median_cm = 100 * float(np.median(np.linalg.norm(error, axis=1)))
    print(f"cam_{number}: {len(four)} frames with 4+ markers, {share:.1%} ok, {median_cm:.2f} cm")
    assert len(four) >= 30
    assert share >= 0.95
    assert median_cm <= 2.3


def test_field_2023(shared_data: Path, tmp_path: Path) -> None:
    """Five photos of AprilTags on two walls; the camera's place by tape measure."""
    folder = shared_data / "field_2023"
    files = read_attachments(folder / "camera.yaml", folder / "map.yaml", None)
    record(open_source(str(folder / "images")), tmp_path / "a.mcap", attachments=files)
    replay(tmp_path / "a.mcap", tmp_path / "r", "r", QUIET)
    poses = open_result(tmp_path / "r").table("poses")
    rows = csv.DictReader((folder / "ground_truth.csv").read_text().splitlines())
    truth = {row["image"]: (float(row["x_m"]), float(row["y_m"])) for row in rows}
    # For these names natural order is that of the alphabet.
    expected = np.array([truth[name] for name in sorted(truth)])
    offset = poses[["x_m", "y_m"]].to_numpy() - expected
    for name, shift, used in zip(sorted(truth), offset, poses["n_used"], strict=True):
        print(f"{name}: {used} tags, x {100 * shift[0]:+.1f} cm, y {100 * shift[1]:+.1f} cm")
    assert poses["status"].tolist() == ["ok"] * 5
    many = poses["n_used"].to_numpy() >= 3
    assert many.any()
    assert np.abs(offset[many]).max() <= 0.20
