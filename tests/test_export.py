"""Exported trajectories against the rules of the formats, and read back."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from pipeline.geometry import Pose
from recorder.errors import InputError
from recorder.files.trajectory_file import parse_csv, parse_tum
from recorder.log.messages import from_pose_in_frame
from recorder.log.trajectory_writer import TimedPose, write_trajectories
from replay.export import export as export_to
from replay.export import trajectory
from replay.export_cli import export
from replay.inputs import Overrides
from replay.result import Result, open_result
from replay.run import ReplayOptions, replay
from tests import worlds

FRAMES = 12
# No image to detect in: before the first fix, and on the way.
DAMAGED = (0, 1, 6, 7)
TRACKERS = ["adaptive", "min", "max", "mean", "median"]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("export")
    log = worlds.small_log(folder / "log.mcap", FRAMES, damaged=DAMAGED)
    replay(log, folder / "result", "drive", ReplayOptions(rrd=False, progress=False))
    return open_result(folder / "result")


@pytest.fixture(scope="module")
def blind(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """No truth but a pose that was stood at: nobody knows its tilt."""
    folder = tmp_path_factory.mktemp("blind")
    log = worlds.small_log(folder / "log.mcap", 3, exact=False)
    replay(log, folder / "result", "drive", ReplayOptions(rrd=False, progress=False))
    return open_result(folder / "result")


def test_tum_is_what_evo_reads(result: Result, tmp_path: Path) -> None:
    """Eight numbers with single spaces, seconds first, quaternion x y z w; # starts a comment."""
    path = tmp_path / "adaptive.tum"
    (exported,) = export_to(result, "tum", "adaptive", path)
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert len(lines) == len(exported.table) == FRAMES - 2
    rows = np.array([[float(field) for field in line.split(" ")] for line in lines])
    assert rows.shape == (FRAMES - 2, 8)
    assert (np.diff(rows[:, 0]) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-12)
    # A float of seconds since 1970 is good to 240 ns: the text has them all.
    stamps = [line.split(" ")[0] for line in lines]
    assert all(re.fullmatch(r"\d+\.\d{9}", stamp) for stamp in stamps)
    assert stamps[0] == "1700000000.200000000"
    assert exported.left_out == 2


def test_evo_itself_reads_the_tum_file(result: Result, tmp_path: Path) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    path = tmp_path / "adaptive.tum"
    (exported,) = export_to(result, "tum", "adaptive", path)
    read = file_interface.read_tum_trajectory_file(str(path))
    table = exported.table
    assert read.check()[0]
    np.testing.assert_allclose(read.timestamps, table["timestamp_ns"] * 1e-9, rtol=0, atol=3e-7)
    np.testing.assert_array_equal(read.positions_xyz, table[["x_m", "y_m", "z_m"]])
    wxyz = table[["qw", "qx", "qy", "qz"]]
    np.testing.assert_allclose(read.orientations_quat_wxyz, wxyz, atol=1e-15)


def test_tum_reads_back_exactly(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "fixes.tum"
    export_to(result, "tum", "fixes", path)
    read = parse_tum(path.read_text(), path)
    poses = result.table("poses")
    fixes = poses[poses["status"] == "ok"]
    assert len(fixes) == FRAMES - len(DAMAGED)
    np.testing.assert_array_equal(read.timestamp_ns, fixes["timestamp_ns"])
    np.testing.assert_array_equal(read.positions_m, fixes[["x_m", "y_m", "z_m"]])
    np.testing.assert_allclose(read.quats_xyzw, fixes[["qx", "qy", "qz", "qw"]], atol=1e-15)


def test_a_tracker_keeps_the_attitude_of_the_last_fix(result: Result) -> None:
    poses = result.table("poses").set_index("frame_index")
    tracks = result.table("tracks").set_index(["tracker", "frame_index"]).loc["min"]
    table = trajectory(result, "min").table.set_index("frame_index")
    assert table.index.tolist() == list(range(2, FRAMES))
    np.testing.assert_array_equal(table[["x_m", "y_m"]], tracks.loc[2:, ["x_m", "y_m"]])
    attitude = ["z_m", "qx", "qy", "qz", "qw"]
    for frame in range(2, FRAMES):
        seen = 5 if frame in (6, 7) else frame
        np.testing.assert_array_equal(table.loc[frame, attitude], poses.loc[seen, attitude])


def test_kitti_is_the_upper_three_rows(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "truth.txt"
    export_to(result, "kitti", "truth", path)
    rows = np.array([[float(n) for n in line.split(" ")] for line in path.read_text().splitlines()])
    assert rows.shape == (FRAMES, 12)
    for row, pose in zip(rows.reshape(-1, 3, 4), worlds.drive(FRAMES), strict=True):
        np.testing.assert_allclose(row, np.column_stack([pose.rotation, pose.translation]))


def test_csv_reads_back_and_serves_as_truth(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    export_to(result, "csv", "truth", path)
    read = parse_csv(path.read_text(), path)
    assert read.frame_index is not None
    assert read.frame_index.tolist() == list(range(FRAMES))
    log = worlds.small_log(tmp_path / "again.mcap", FRAMES, exact=False)
    options = ReplayOptions(overrides=Overrides(truth=path), rrd=False, progress=False)
    summary = replay(log, tmp_path / "again", "again", options)
    assert summary["errors"]["measured"]["fixes"]["n"] == FRAMES


def test_csv_has_the_further_columns_of_what_it_is(result: Result, tmp_path: Path) -> None:
    for name, column in (("fixes", "n_used"), ("mean", "var_x_m2"), ("truth", "std_m")):
        export_to(result, "csv", name, tmp_path / "x.csv")
        header = (tmp_path / "x.csv").read_text().splitlines()[0].split(",")
        assert header[:3] == ["frame_index", "timestamp_ns", "x_m"]
        assert column in header


def test_mcap_has_a_pose_topic_for_each_and_moves_the_camera(
    result: Result, tmp_path: Path
) -> None:
    path = tmp_path / "all.mcap"
    export_to(result, "mcap", None, path)
    counts: Counter[tuple[str, str]] = Counter()
    track, transforms = {}, {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            counts[channel.topic, schema.name] += 1
            if channel.topic == "/track/adaptive":
                stamp, frame, pose = from_pose_in_frame(decoded)
                assert (stamp, frame) == (message.log_time, "map")
                track[stamp] = pose
            if channel.topic == "/tf/camera":
                assert (decoded.parent_frame_id, decoded.child_frame_id) == ("map", "camera")
                t = decoded.translation
                transforms[message.log_time] = [t.x, t.y, t.z]
        assert {a.name for a in reader.iter_attachments()} == {
            "camera.yaml",
            "map.yaml",
            "truth.yaml",
        }
    assert counts == {
        **{(f"/track/{name}", "foxglove.PoseInFrame"): FRAMES - 2 for name in TRACKERS},
        ("/fix", "foxglove.PoseInFrame"): FRAMES - len(DAMAGED),
        ("/truth/exact", "foxglove.PoseInFrame"): FRAMES,
        ("/tf/camera", "foxglove.FrameTransform"): FRAMES - 2,
        ("/tf", "foxglove.FrameTransforms"): 1,
        ("/truth/path", "foxglove.PosesInFrame"): 1,
        ("/camera/calibration", "foxglove.CameraCalibration"): 1,
    }
    table = trajectory(result, "adaptive").table
    assert list(track) == table["timestamp_ns"].tolist()
    for row, stamp in zip(table[["x_m", "y_m", "z_m"]].to_numpy(), track, strict=True):
        np.testing.assert_array_equal(track[stamp].translation, row)
        np.testing.assert_array_equal(transforms[stamp], row)
    export_to(result, "mcap", None, tmp_path / "twice.mcap")
    assert (tmp_path / "twice.mcap").read_bytes() == path.read_bytes()


def test_rerun_draws_the_mcap(result: Result, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    path, rrd = tmp_path / "fixes.mcap", tmp_path / "fixes.rrd"
    export_to(result, "mcap", "fixes", path)
    command = [sys.executable, "-m", "rerun", "mcap", "convert", str(path), "-o", str(rrd)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    components: dict[str, set[str]] = {}
    for chunk in RrdReader(rrd).stream():
        names = components.setdefault(str(chunk.entity_path), set())
        names |= {str(name) for name in chunk.to_record_batch().schema.names}
    assert "/track/adaptive" not in components
    assert "InstancePoses3D:translations" in components["/fix"]
    assert "Transform3D:translation" in components["/tf/camera"]


def test_what_there_is_none_of_is_one_line(result: Result, blind: Result, tmp_path: Path) -> None:
    path = tmp_path / "x.tum"
    with pytest.raises(InputError, match=r"expected one of adaptive, .*, fixes, truth, found 'kf'"):
        export_to(result, "tum", "kf", path)
    with pytest.raises(InputError, match=r"expected whole poses .* of truth, found none"):
        export_to(blind, "tum", "truth", path)
    (exported, *_) = export_to(blind, "mcap", None, tmp_path / "x.mcap")
    assert exported.name == "fixes"
    assert not path.exists()


def test_a_damaged_table_is_one_line(result: Result, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(result.folder, damaged)
    for name in ("tracks", "poses", "truth", "detections"):
        path = damaged / f"{name}.parquet"
        whole = path.read_bytes()
        for data in (whole[: len(whole) // 2], b"", b"PAR1 and no more PAR1"):
            path.write_bytes(data)
            with pytest.raises(InputError, match=f"{name}.parquet: expected a Parquet table") as e:
                open_result(damaged).table(name)
            assert "\n" not in str(e.value)
        path.write_bytes(whole)


def test_a_write_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def poses() -> Iterator[TimedPose]:
        yield TimedPose(0, 0, Pose.identity())
        raise ValueError("no more of them")

    with pytest.raises(ValueError, match="no more of them"):
        write_trajectories(
            tmp_path / "x.mcap", {"/fix": poses()}, camera_topic="/fix", attachments={}, metadata={}
        )
    assert not list(tmp_path.iterdir())


def test_the_verb_names_files_and_replaces_none_unasked(result: Result) -> None:
    folder = result.folder
    done = CliRunner().invoke(export(), [str(folder), "--format", "tum"])
    assert done.exit_code == 0, done.output
    assert done.output == f"{folder / 'adaptive.tum'}: adaptive, 10 poses, 2 frames without\n"
    done = CliRunner().invoke(export(), [str(folder), "--format", "tum"])
    assert isinstance(done.exception, InputError)
    assert "--force" in str(done.exception)
    done = CliRunner().invoke(export(), [str(folder), "--format", "tum", "--force"])
    assert done.exit_code == 0
    done = CliRunner().invoke(export(), [str(folder), "--format", "mcap"])
    assert done.exit_code == 0
    assert (folder / "trajectories.mcap").exists()
    assert CliRunner().invoke(export(), [str(folder)]).exit_code == 2
