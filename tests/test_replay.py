"""From a log to a result: the tables' contract, determinism, and what happens to bad logs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.localizer import Frame, Localizer, PipelineSettings
from recorder.errors import InputError
from recorder.image_decoding import decode_gray
from recorder.log.reader import LogReader
from recorder.log.records import LogImage
from replay.inputs import Overrides
from replay.report import summary_text, warnings
from replay.result import new_result, open_result
from replay.run import ReplayOptions, replay
from tests import worlds

CONTRACT = {
    "detections": "frame_index timestamp_ns marker_id corner u_px v_px",
    "poses": "frame_index timestamp_ns status n_detected n_used n_explained x_m y_m z_m "
    "qx qy qz qw yaw_rad reprojection_rms_px",
    "tracks": "frame_index timestamp_ns tracker updated x_m vx_mps y_m vy_mps var_x_m2 var_y_m2 "
    "r_x_m2 r_y_m2 innovation_x_m innovation_y_m nis",
    "truth": "frame_index timestamp_ns kind x_m y_m z_m qx qy qz qw yaw_rad std_m",
}
N_FRAMES = 12


def options(**changes: Any) -> ReplayOptions:
    return ReplayOptions(**{"rrd": False, "progress": False, **changes})


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return worlds.small_log(tmp_path_factory.mktemp("log") / "a.mcap", N_FRAMES, damaged=(4,))


@pytest.fixture(scope="module")
def result(log: Path) -> Path:
    replay(log, log.parent / "result", "result", options())
    return log.parent / "result"


def test_tables_have_the_contracts_columns_in_its_order(result: Path) -> None:
    for name, columns in CONTRACT.items():
        found = pq.read_schema(result / f"{name}.parquet").names
        expected = columns.split()
        assert found[: len(expected)] == expected


def test_every_frame_has_one_pose_row_and_one_row_per_tracker(result: Path) -> None:
    opened = open_result(result)
    poses, tracks = opened.table("poses"), opened.table("tracks")
    assert poses["frame_index"].tolist() == list(range(N_FRAMES))
    assert (np.diff(poses["timestamp_ns"]) == worlds.FRAME_NS).all()
    assert poses["status"].tolist() == ["ok"] * 4 + ["undecodable"] + ["ok"] * 7
    assert tracks.groupby("tracker", sort=False).size().to_dict() == dict.fromkeys(
        ("adaptive", "min", "max", "mean", "median"), N_FRAMES
    )
    skipped = tracks[tracks["frame_index"] == 4]
    assert not skipped["updated"].any()
    assert skipped[["nis", "innovation_x_m", "r_x_m2"]].isna().all(axis=None)
    assert skipped[["x_m", "y_m", "var_x_m2"]].notna().all(axis=None)


def test_poses_are_where_the_pictures_were_drawn_from(result: Path) -> None:
    opened = open_result(result)
    poses, truth = opened.table("poses"), opened.table("truth")
    exact = truth[truth["kind"] == "exact"].set_index("frame_index")
    for i, T_map_camera in enumerate(worlds.drive(N_FRAMES)):
        np.testing.assert_array_equal(exact.loc[i, ["x_m", "y_m", "z_m"]], T_map_camera.translation)
        assert exact.loc[i, "yaw_rad"] == T_map_camera.yaw_rad
    merged = poses[poses["status"] == "ok"].set_index("frame_index").join(exact, rsuffix="_true")
    for axis, limit in (("x_m", 0.005), ("y_m", 0.005), ("z_m", 0.01), ("yaw_rad", 0.002)):
        assert (merged[axis] - merged[f"{axis}_true"]).abs().max() < limit


def test_detections_are_the_markers_corners(result: Path) -> None:
    detections = open_result(result).table("detections")
    expected = worlds.corners(worlds.drive(1)[0], worlds.camera(ideal=True), worlds.ceiling())
    first = detections[detections["frame_index"] == 0]
    assert sorted(first["marker_id"].unique()) == sorted(expected.ids)
    for marker_id, corners in zip(expected.ids, expected.corners_px, strict=True):
        rows = first[first["marker_id"] == marker_id]
        assert rows["corner"].tolist() == [0, 1, 2, 3]
        assert np.abs(rows[["u_px", "v_px"]].to_numpy() - corners).max() < 2.0


def test_the_same_log_and_settings_give_the_same_tables_bit_for_bit(
    log: Path, result: Path, tmp_path: Path
) -> None:
    for jobs in (1, 2, 3):
        again = tmp_path / str(jobs)
        replay(log, again, "result", options(jobs=jobs))
        for name in CONTRACT:
            file = f"{name}.parquet"
            assert (again / file).read_bytes() == (result / file).read_bytes()
        assert (again / "settings.yaml").read_bytes() == (result / "settings.yaml").read_bytes()


def test_replay_equals_live(log: Path, result: Path) -> None:
    """The same frames through `Localizer.step`, one by one, as a live camera would give them."""
    with LogReader(log) as reader:
        camera, marker_map = reader.camera(), reader.marker_map()
        assert camera is not None
        assert marker_map is not None
        assert reader.start_ns is not None
        localizer = Localizer(PipelineSettings(), camera, marker_map, reader.start_ns)
        live = [
            localizer.step(Frame(r.frame_index, r.timestamp_ns, decode_gray(r.data)))
            for r in reader.records()
            if isinstance(r, LogImage)
        ]
    tracks = open_result(result).table("tracks")
    for step in live:
        rows = tracks[tracks["frame_index"] == step.frame_index].set_index("tracker")
        for name, track in step.tracks.items():
            np.testing.assert_array_equal(
                rows.loc[name, ["x_m", "vx_mps", "y_m", "vy_mps"]].astype(float), track.x
            )


def test_the_result_has_all_that_analysis_needs(log: Path, result: Path) -> None:
    with LogReader(log) as reader:
        for name in ("camera.yaml", "map.yaml", "truth.yaml"):
            assert (result / name).read_bytes() == reader.attachments[name]
        sha256 = reader.sha256()
    summary = json.loads((result / "summary.json").read_text())
    assert summary["log_sha256"] == sha256
    assert summary["status"] == {"ok": 11, "undecodable": 1}
    assert summary["log_cut_short"] is None
    assert summary["versions"]["opencv-contrib-python-headless"].startswith("5.")
    assert set(summary["errors"]) == {"exact", "measured", "path"}
    assert list(summary["errors"]["exact"]) == ["fixes", "adaptive", "min", "max", "mean", "median"]


def test_resolved_settings_replay_the_same(log: Path, result: Path, tmp_path: Path) -> None:
    settings = open_result(result).settings
    replay(log, tmp_path / "again", "again", options(settings=settings))
    assert (tmp_path / "again/tracks.parquet").read_bytes() == (
        result / "tracks.parquet"
    ).read_bytes()


def test_a_span_of_the_log_keeps_the_logs_seconds(log: Path, tmp_path: Path) -> None:
    settings = PipelineSettings.model_validate(
        {"pose": {"max_markers": [{"until_s": 0.75, "n": 2}, {"n": None}]}}
    )
    summary = replay(log, tmp_path / "r", "r", options(settings=settings, from_s=0.6, to_s=1.0))
    poses = open_result(tmp_path / "r").table("poses")
    assert poses["frame_index"].tolist() == [6, 7, 8, 9]
    assert poses["n_used"].tolist()[:2] == [2, 2]
    assert (poses["n_used"][2:] > 2).all()
    assert summary["from_s"] == 0.6


def test_a_log_that_was_cut_short_replays_its_whole_chunks(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = log.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    summary = replay(cut, tmp_path / "r", "r", options())
    assert "cut short" in summary["log_cut_short"]
    assert 0 < summary["frames"] < N_FRAMES


def test_files_given_take_the_place_of_the_logs(log: Path, tmp_path: Path) -> None:
    with LogReader(log) as reader:
        text = reader.attachments["map.yaml"].decode()
    moved = tmp_path / "moved.yaml"
    moved.write_text(text.replace("2.5]", "2.6]"))
    assert text.count("2.5]") == 12
    summary = replay(log, tmp_path / "r", "r", options(overrides=Overrides(map=moved)))
    assert summary["overrides"] == ["map"]
    assert (tmp_path / "r/map.yaml").read_bytes() == moved.read_bytes()
    # The whole ceiling is 10 cm higher, and so is the camera below it.
    z_m = open_result(tmp_path / "r").table("poses")["z_m"].dropna()
    assert z_m.mean() == pytest.approx(0.4, abs=0.01)


def failing(log: Path, tmp_path: Path, **changes: Any) -> str:
    """The one line that a replay ends in; it leaves nothing behind."""
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError) as caught:
        replay(log, tmp_path / "deep/er/result", "result", options(**changes))
    assert sorted(tmp_path.rglob("*")) == before
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("missing", "option"), [("camera.yaml", "--camera"), ("map.yaml", "--map")]
)
def test_a_log_without_calibration_or_map_says_how_to_give_one(
    missing: str, option: str, tmp_path: Path
) -> None:
    kept = tuple(n for n in ("camera.yaml", "map.yaml", "truth.yaml") if n != missing)
    log = worlds.small_log(tmp_path / "a.mcap", 1, attachments=kept)
    assert option in failing(log, tmp_path)


def test_images_of_another_size_than_the_calibrations(log: Path, tmp_path: Path) -> None:
    with LogReader(log) as reader:
        text = reader.attachments["camera.yaml"].decode()
    small = tmp_path / "camera.yaml"
    small.write_text(text.replace("image_width: 1280", "image_width: 640"))
    message = failing(log, tmp_path, overrides=Overrides(camera=small))
    assert "640x720" in message
    assert "1280x720" in message


def test_an_empty_log_and_an_empty_span(log: Path, tmp_path: Path) -> None:
    empty = worlds.small_log(tmp_path / "empty.mcap", 0)
    assert "expected images on /camera/image, found none" in failing(empty, tmp_path)
    assert "99" in failing(log, tmp_path, from_s=99.0)


def test_a_file_that_is_no_log(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(b"certainly not")
    assert "expected an MCAP log" in failing(other, tmp_path)
    assert "found no file" in failing(tmp_path / "none.mcap", tmp_path)


def test_a_result_that_exists_is_kept_unless_forced(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "result"
    replay(log, out, "result", options(to_s=0.3))
    with pytest.raises(InputError, match="--force"):
        replay(log, out, "result", options())
    assert open_result(out).summary["frames"] == 3
    replay(log, out, "result", options(to_s=0.4, force=True))
    assert open_result(out).summary["frames"] == 4


def test_two_replays_to_one_place_do_not_write_into_each_other(tmp_path: Path) -> None:
    """The first to end has the name; the other may not replace it unasked."""

    def both() -> None:
        with new_result(tmp_path / "r") as one:
            (one / "mine").write_text("slow")
            with new_result(tmp_path / "r") as two:
                assert not (two / "mine").exists()
                (two / "mine").write_text("quick")

    with pytest.raises(InputError, match="another replay"):
        both()
    assert (tmp_path / "r/mine").read_text() == "quick"
    assert [path.name for path in tmp_path.iterdir()] == ["r"]


def test_a_truth_of_another_time_is_said(log: Path, tmp_path: Path) -> None:
    late = tmp_path / "late.yaml"
    late.write_text("frame: map\nposes: [{from_s: 100, to_s: 110, x_m: 0, y_m: 0, std_m: 0.01}]\n")
    summary = replay(log, tmp_path / "r", "r", options(overrides=Overrides(truth=late)))
    assert summary["truth_without_frames"]
    assert any("says nothing" in line for line in warnings(summary))


def test_no_pose_in_any_frame_comes_with_a_hint(log: Path, tmp_path: Path) -> None:
    with LogReader(log) as reader:
        text = reader.attachments["map.yaml"].decode()
    upside_down = tmp_path / "map.yaml"
    upside_down.write_text(text.replace("DICT_6X6_1000", "DICT_5X5_1000"))
    summary = replay(log, tmp_path / "r", "r", options(overrides=Overrides(map=upside_down)))
    assert summary["status"].get("ok") is None
    assert any("dictionary" in line for line in warnings(summary))
    assert "nan" not in summary_text(tmp_path / "r", summary)


def test_a_folder_that_is_no_result_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("years of work")
    with (
        pytest.raises(InputError, match="something else"),
        new_result(tmp_path / "mine", force=True),
    ):
        pass
    assert (tmp_path / "mine/thesis.tex").exists()


def test_results_of_another_version_and_folders_that_are_none(result: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found none"):
        open_result(tmp_path / "none")
    with pytest.raises(InputError, match=r"no summary\.json"):
        open_result(tmp_path)
    (tmp_path / "summary.json").write_text('{"tables_version": 99}')
    with pytest.raises(InputError, match="expected version 1, found 99"):
        open_result(tmp_path)
