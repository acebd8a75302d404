"""A log of a camera at its worst replays: every frame has its row, and the tracks go on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from recorder.log.reader import LogReader
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.sources.base import CapturedFrame
from replay.report import warnings
from replay.result import open_result
from replay.run import ReplayOptions
from replay.run import replay as replay_log
from tests import worlds
from tests.live_sources import LiveScript
from tests.log_helpers import images

HOUR_NS = 3_600_000_000_000
FRAMES = 24
SET_BACK_AT = 12


class Camera(LiveScript):
    """A drive at 10 frames/s whose clock is set back by an hour; frame 5 empty, 7 cut, 9 lost."""

    image_size = (1280, 720)

    def __init__(self, path: Path) -> None:
        frames = []
        with LogReader(worlds.small_log(path, FRAMES, exact=False)) as log:
            self.files = dict(log.attachments)
            for image in images(log):
                back_ns = HOUR_NS if image.frame_index >= SET_BACK_AT else 0
                data = {5: b"", 7: image.data[:-500]}.get(image.frame_index, image.data)
                stamp_ns = image.timestamp_ns - back_ns
                if image.frame_index != 9:
                    frames.append(
                        CapturedFrame(image.frame_index, stamp_ns, image.arrival_ns, data, "jpeg")
                    )
        super().__init__(frames)

    @property
    def attachments(self) -> dict[str, bytes]:
        return self.files


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("faulty")
    summary = record(Camera(folder / "drawn.mcap"), folder / "log.mcap")
    counts = summary.counts
    assert (counts.written, counts.dropped, counts.corrupt, counts.stamped_back) == (23, 1, 2, 1)
    replay_log(folder / "log.mcap", folder / "result", "all", ReplayOptions(progress=False))
    return folder / "result"


def test_every_frame_has_its_row(result: Path) -> None:
    poses = pd.read_parquet(result / "poses.parquet")
    assert poses["frame_index"].tolist() == [i for i in range(FRAMES) if i != 9]
    assert open_result(result).summary["duration_s"] == pytest.approx(0.1 * (FRAMES - 2))
    odd = poses[poses["status"] != "ok"]
    assert set(odd["frame_index"]) <= {5, 7}
    assert poses.set_index("frame_index").loc[5, "status"] == "undecodable"
    assert (result / "replay.rrd").stat().st_size > 10_000


def test_tracks_go_on_behind_a_clock_that_was_set_back(result: Path) -> None:
    tracks = pd.read_parquet(result / "tracks.parquet")
    track = tracks[tracks["tracker"] == "adaptive"].set_index("frame_index")
    assert np.isfinite(track[["x_m", "vx_mps", "y_m", "vy_mps", "var_x_m2"]]).all(axis=None)
    expected = pd.Series({i: pose.translation[0] for i, pose in enumerate(worlds.drive(FRAMES))})
    error_m = (track["x_m"] - expected).dropna()
    # The filter lags this drive from a standing start; what counts is that it does not stop.
    before, after = error_m[SET_BACK_AT - 1], error_m.iloc[-1]
    assert abs(after) < abs(before) + 0.02
    assert track["vx_mps"].iloc[-1] > 0.5 * 0.2
    # Time passes again: without fixes the variance would grow, with them v is still learnt.
    moved_m = track["x_m"].iloc[-1] - track["x_m"][SET_BACK_AT]
    assert moved_m == pytest.approx(0.02 * (FRAMES - 1 - SET_BACK_AT), rel=0.2)


def test_an_image_damaged_inside_gives_no_pose(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """OpenCV would show its lower part shifted, and the detector find markers in there."""
    with LogReader(worlds.small_log(tmp_path / "drawn.mcap", 6, exact=False)) as log:
        files, drawn = dict(log.attachments), images(log)
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments=files, session={}) as writer:
        for image in drawn:
            data = image.data
            if image.frame_index == 3:
                middle = len(data) // 2
                data = data[:middle] + data[middle + 200 :]
            stamps = (image.timestamp_ns, image.arrival_ns)
            writer.write_frame(CapturedFrame(image.frame_index, *stamps, data, "jpeg"))
    capfd.readouterr()
    summary = replay_log(path, tmp_path / "result", "all", ReplayOptions(progress=False))
    assert summary["status"] == {"ok": 5, "undecodable": 1}
    poses = pd.read_parquet(tmp_path / "result" / "poses.parquet")
    assert poses.set_index("frame_index").loc[3, "status"] == "undecodable"
    said = "1 image damaged or of another size, without a pose; `arucolog verify` says which"
    assert said in warnings(summary)
    # Nor does a decoder print lines of its own.
    assert capfd.readouterr().err == ""
