"""Rerun recordings: what is in the file, and that several results of a log become one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pipeline.detection import Detections
from pipeline.geometry import Pose
from pipeline.localizer import FrameResult, Localizer, PipelineSettings
from recorder.errors import InputError
from recorder.files.truth_file import Truth, TruthPath
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent, LogImage
from replay.run import ReplayOptions, replay
from replay.viewer import scene, style
from replay.viewer.layout import ResultLayout, eye_on
from replay.viewer.open import prepare, view
from replay.viewer.overlay import ResultRecording, overlay
from replay.viewer.recording import ReplayRecording
from replay.viewer.status import StatusEvents
from tests import worlds
from tests.rrd_files import chunks, entities, rows, static

LOG_ID = "5e" * 32
N_FRAMES = 12
SETTINGS = PipelineSettings.model_validate(
    {
        "trackers": {
            "adaptive": {"variance": {"kind": "table"}},
            "max": {"variance": {"kind": "static", "statistic": "max"}},
        }
    }
)


def images() -> list[LogImage]:
    stamps = [worlds.START_NS + i * worlds.FRAME_NS for i in range(N_FRAMES)]
    # The bytes only have to arrive: no decoder is asked.
    return [LogImage(i, t, t, b"\xff\xd8" + bytes([i]) * 50, "jpeg") for i, t in enumerate(stamps)]


def record(path: Path, name: str, *, exact: bool = True, seed: int = 0) -> list[FrameResult]:
    """A replay of perfect corners with noise; frame 5 sees nothing, frame 6 an unknown marker."""
    lens, marker_map = worlds.camera(ideal=True), worlds.ceiling()
    localizer = Localizer(SETTINGS, lens, marker_map, worlds.START_NS)
    truth = Truth("map", "drawn", TruthPath(np.array([[-0.3, 0.1], [0.3, 0.1]]), False, 0.05))
    results = []
    with ReplayRecording(
        path,
        log_id=LOG_ID,
        result_name=name,
        camera=lens,
        marker_map=marker_map,
        tracker_names=tuple(SETTINGS.trackers),
        start_ns=worlds.START_NS,
        truth=truth,
    ) as recording:
        recording.log_event(LogEvent(worlds.START_NS + 1, "warning", "at the door", "waypoint"))
        for image, pose in zip(images(), worlds.drive(N_FRAMES), strict=True):
            seen = worlds.with_noise(worlds.corners(pose, lens, marker_map), 0.3, seed)
            if image.frame_index == 5:
                seen = Detections.none()
            if image.frame_index == 6:
                seen = Detections(
                    np.append(seen.ids, 99),
                    np.append(seen.corners_px, seen.corners_px[:1] + 200, axis=0),
                )
            result = localizer.advance(image.frame_index, image.timestamp_ns, seen)
            recording.log_frame(image, result, pose if exact else None)
            results.append(result)
    return results


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[FrameResult]]:
    path = tmp_path_factory.mktemp("viewer") / "replay.rrd"
    return path, record(path, "paper")


def test_one_recording_with_a_layout_and_ids_that_merge(
    replayed: tuple[Path, list[FrameResult]],
) -> None:
    (recording,) = RrdReader(replayed[0]).recordings()
    assert (recording.application_id, recording.recording_id) == (style.APPLICATION_ID, LOG_ID)
    assert len(RrdReader(replayed[0]).blueprints()) == 1


def test_every_part_of_the_picture_is_there(replayed: tuple[Path, list[FrameResult]]) -> None:
    paths = style.ResultPaths("paper")
    expected = {
        style.MARKERS,
        style.MARKER_IDS,
        style.CAMERA,
        style.IMAGE,
        style.TRUTH_EXACT,
        "/truth/path",
        "/truth/band",
        style.EVENTS,
        paths.detections,
        paths.labels,
        paths.events,
        f"{paths.fixes}/ok",
        paths.plot("markers", "used"),
        paths.plot("nis", "bound"),
    }
    for tracker in SETTINGS.trackers:
        expected |= {f"{paths.tracker(tracker)}/{leaf}" for leaf in ("path", "position", "ellipse")}
        expected |= {paths.plot(kind, tracker) for kind in ("error", "nis")}
        expected |= {paths.innovation(tracker, axis) for axis in ("x", "y")}
    assert expected <= entities(replayed[0])


def test_image_bytes_pass_unchanged(replayed: tuple[Path, list[FrameResult]]) -> None:
    blobs = rows(replayed[0], style.IMAGE, "EncodedImage:blob")
    found = {frame: bytes(blob[0]) for frame, blob in blobs.items()}
    assert found == {image.frame_index: image.data for image in images()}


def test_time_is_the_logs_seconds(replayed: tuple[Path, list[FrameResult]]) -> None:
    for chunk in chunks(replayed[0], style.IMAGE):
        batch = chunk.to_record_batch()
        assert set(chunk.timeline_names) == {style.FRAME, style.TIME}
        frames = np.array(batch.column(style.FRAME))
        times_ns = np.array(batch.column(style.TIME)).astype(np.int64)
        np.testing.assert_array_equal(times_ns, frames * worlds.FRAME_NS)


def test_series_hold_the_results(replayed: tuple[Path, list[FrameResult]]) -> None:
    path, results = replayed
    paths = style.ResultPaths("paper")
    poses = worlds.drive(N_FRAMES)
    for tracker in SETTINGS.trackers:
        tracks = {r.frame_index: r.tracks[tracker] for r in results}
        updated = {f: t for f, t in tracks.items() if np.isfinite(t.nis)}
        nis = rows(path, paths.plot("nis", tracker), "Scalars:scalars")
        assert nis == {f: [pytest.approx(t.nis)] for f, t in updated.items()}
        entity = paths.innovation(tracker, "y")
        values = rows(path, entity, "Measurements:values")
        variances = rows(path, entity, "Measurements:variances")
        assert values == {f: [pytest.approx(t.innovation_m[1])] for f, t in updated.items()}
        assert variances == {f: [pytest.approx(t.innovation_var_m2[1])] for f, t in updated.items()}
        errors = rows(path, paths.plot("error", tracker), "Scalars:scalars")
        assert errors == {
            f: [pytest.approx(np.hypot(*(t.x[[0, 2]] - poses[f].translation[:2])))]
            for f, t in tracks.items()
        }
        line = np.array(static(path, f"{paths.tracker(tracker)}/path", "LineStrips3D:strips"))
        expected = np.array([t.x[[0, 2]] for t in tracks.values()])
        np.testing.assert_allclose(line[0, :, :2], expected, atol=1e-6)
    used = rows(path, paths.plot("markers", "used"), "Scalars:scalars")
    assert used == {r.frame_index: [r.fix.n_used] for r in results}


def test_ellipse_is_three_sigma(replayed: tuple[Path, list[FrameResult]]) -> None:
    path, results = replayed
    entity = f"{style.ResultPaths('paper').tracker('max')}/ellipse"
    half_sizes = rows(path, entity, "Ellipsoids3D:half_sizes")
    for result in results:
        covariance = result.tracks["max"].P[np.ix_([0, 2], [0, 2])]
        sigmas = np.sqrt(np.linalg.eigvalsh(covariance))
        found = np.array(half_sizes[result.frame_index])[0, :2]
        np.testing.assert_allclose(found, 3 * sigmas, rtol=1e-5)


def test_corners_are_drawn_at_rerun_pixels_and_say_what_became_of_them(
    replayed: tuple[Path, list[FrameResult]],
) -> None:
    path, results = replayed
    paths = style.ResultPaths("paper")
    corners = rows(path, paths.corners, "Points2D:positions")
    labels = rows(path, paths.labels, "Points2D:labels")
    for result in results:
        expected = result.detections.corners_px.reshape(-1, 2) + 0.5
        found = np.array(corners[result.frame_index]).reshape(-1, 2)
        np.testing.assert_allclose(found, expected, atol=1e-3)
    assert labels[5] == []
    assert "99 not in map" in labels[6]
    assert labels[0] == [str(i) for i in results[0].detections.ids]


def test_nothing_is_left_of_a_replay_that_failed(tmp_path: Path) -> None:
    lens, marker_map = worlds.camera(), worlds.ceiling()
    with (
        pytest.raises(KeyboardInterrupt),
        ReplayRecording(
            tmp_path / "replay.rrd",
            log_id=LOG_ID,
            result_name="x",
            camera=lens,
            marker_map=marker_map,
            tracker_names=("adaptive",),
            start_ns=0,
        ),
    ):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_untimed_path_gives_distances(tmp_path: Path) -> None:
    results = record(tmp_path / "replay.rrd", "paper", exact=False)
    entity = style.ResultPaths("paper").plot("path_distance", "adaptive")
    found = rows(tmp_path / "replay.rrd", entity, "Scalars:scalars")
    # The path lies at y = 0.1, from x = -0.3 to 0.3.
    xy = {r.frame_index: r.tracks["adaptive"].x[[0, 2]] for r in results}
    expected = {f: np.hypot(min(x + 0.3, 0.0), y - 0.1) for f, (x, y) in xy.items()}
    assert found == {f: [pytest.approx(d, abs=1e-9)] for f, d in expected.items()}


def test_overlay_shares_images_and_keeps_results_apart(tmp_path: Path) -> None:
    for k, name in enumerate(("a", "b", "a")):
        record(tmp_path / f"{k}.rrd", name, seed=k)
    results = [ResultRecording(tmp_path / f"{k}.rrd", n, n) for k, n in enumerate("aba")]
    overlay(results, tmp_path / "all.rrd", LOG_ID, "log")
    (recording,) = RrdReader(tmp_path / "all.rrd").recordings()
    assert recording.recording_id == LOG_ID
    n_images = sum(c.num_rows for c in chunks(tmp_path / "all.rrd", style.IMAGE) if not c.is_static)
    assert n_images == N_FRAMES
    colours = set()
    for k, name in enumerate(("a", "b", "a (2)")):
        shown, own = style.ResultPaths(name), style.ResultPaths("aba"[k])
        for tracker in SETTINGS.trackers:
            entity, before = shown.plot("nis", tracker), own.plot("nis", tracker)
            names = static(tmp_path / "all.rrd", entity, "SeriesLines:names")
            assert names == [f"{name}/{tracker}"]
            colours |= set(static(tmp_path / "all.rrd", entity, "SeriesLines:colors"))
            merged = rows(tmp_path / "all.rrd", entity, "Scalars:scalars")
            assert merged == rows(tmp_path / f"{k}.rrd", before, "Scalars:scalars")
    assert len(colours) == 6


@pytest.fixture(scope="module")
def result_folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A log and two results of it."""
    from replay.run import ReplayOptions, replay

    folder = tmp_path_factory.mktemp("results")
    log = worlds.small_log(folder / "drive.mcap", 4)
    for name in ("one", "two"):
        replay(log, folder / name, name, ReplayOptions(settings=SETTINGS, progress=False))
    return log, folder / "one", folder / "two"


def test_saves_an_overlay(result_folders: tuple[Path, Path, Path], tmp_path: Path) -> None:
    _, one, two = result_folders
    view([one, two], save=tmp_path / "both.rrd")
    found = entities(tmp_path / "both.rrd")
    assert {style.ResultPaths(n).plot("nis", "max") for n in ("one", "two")} <= found
    assert [p.name for p in tmp_path.iterdir()] == ["both.rrd"]


def test_replaces_a_file_only_by_force(
    result_folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    log, one, _ = result_folders
    save = tmp_path / "one.rrd"
    save.write_bytes(b"other")
    with pytest.raises(InputError, match="--force"):
        view([one], save=save)
    assert save.read_bytes() == b"other"
    view([one], save=save, force=True)
    assert save.read_bytes() == (one / "replay.rrd").read_bytes()
    before = log.read_bytes()
    for paths, own in (([log], log), ([one], one / "replay.rrd")):
        with pytest.raises(InputError, match="one to view"):
            view(paths, save=own, force=True)
    assert log.read_bytes() == before


def test_a_log_beside_its_results_adds_nothing(
    result_folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    log, one, _ = result_folders
    assert prepare([one, log], tmp_path) == [one / "replay.rrd"]


def test_saves_a_raw_log(result_folders: tuple[Path, Path, Path], tmp_path: Path) -> None:
    log, _, _ = result_folders
    view([log], save=tmp_path / "log.rrd")
    with LogReader(log) as reader:
        data = {r.frame_index: r.data for r in reader.records() if isinstance(r, LogImage)}
        (recording,) = RrdReader(tmp_path / "log.rrd").recordings()
        assert recording.recording_id == reader.sha256()
    blobs = rows(tmp_path / "log.rrd", style.IMAGE, "EncodedImage:blob")
    assert {f: bytes(b[0]) for f, b in blobs.items()} == data
    positions = rows(tmp_path / "log.rrd", style.CAMERA, "Transform3D:translation")
    expected = np.array([pose.translation for pose in worlds.drive(4)])
    np.testing.assert_allclose([p[0] for p in positions.values()], expected, atol=1e-6)


def test_a_log_that_was_cut_short_is_shown_with_a_word(tmp_path: Path) -> None:
    log = worlds.small_log(tmp_path / "log.mcap")
    data = log.read_bytes()
    log.write_bytes(data[: len(data) // 2])
    told: list[str] = []
    view([log], save=tmp_path / "log.rrd", warn=told.append)
    (text,) = told
    assert text.startswith(f"{log}: cut short after ")


def test_results_of_different_logs_are_refused(
    result_folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    log, one, _ = result_folders
    other = tmp_path / "other"
    other.mkdir()
    summary = json.loads((one / "summary.json").read_text())
    (other / "summary.json").write_text(json.dumps(summary | {"log_sha256": "0" * 64}))
    for paths in ([one, other], [other, log]):
        with pytest.raises(InputError, match="one at a time"):
            prepare(paths, tmp_path)


def test_result_without_a_recording_says_how_to_make_one(
    result_folders: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "bare"
    folder.mkdir()
    (folder / "summary.json").write_text((result_folders[1] / "summary.json").read_text())
    with pytest.raises(InputError, match="without --no-rrd"):
        prepare([folder], tmp_path)


def test_no_screen_is_one_line(
    result_folders: tuple[Path, Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("replay.viewer.open.has_display", lambda: False)
    with pytest.raises(InputError, match="--save"):
        view([result_folders[1]])


def test_status_events_come_at_changes(replayed: tuple[Path, list[FrameResult]]) -> None:
    events = StatusEvents("r")
    said = {r.frame_index: events.changes(r) for r in replayed[1]}
    assert {frame for frame, messages in said.items() if messages} == {0, 5, 6}
    assert said[5][0][0] == "WARN"
    assert "no_markers" in said[5][0][1]
    assert "after 1 frame of no_markers" in said[6][0][1]


def square(side_m: float) -> TruthPath:
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * side_m
    return TruthPath(points, True, 0.1)


def test_band_keeps_its_width_at_corners() -> None:
    left, right = scene.band(square(2.0))
    np.testing.assert_allclose(left[:4], [[0.1, 0.1], [1.9, 0.1], [1.9, 1.9], [0.1, 1.9]])
    np.testing.assert_allclose(right[:4], [[-0.1, -0.1], [2.1, -0.1], [2.1, 2.1], [-0.1, 2.1]])
    np.testing.assert_array_equal(left[0], left[-1])


@pytest.mark.parametrize(
    "points", [[[0, 0], [1, 0], [0, 0]], [[0, 0], [0, 0]], [[0, 0], [0, 0], [1, 0]]]
)
def test_band_of_odd_paths_is_finite(points: list[list[float]]) -> None:
    left, right = scene.band(TruthPath(np.array(points, dtype=float), False, 0.1))
    assert np.isfinite(left).all()
    assert np.isfinite(right).all()


def colour_cases() -> Iterator[list[str]]:
    yield ["adaptive", "min", "max", "mean", "median"]
    yield ["min", "mine", "adaptive"]
    yield ["a", "b", "c", "d", "e", "f", "g"]


@pytest.mark.parametrize("names", list(colour_cases()))
def test_tracker_colours_are_distinct_and_the_papers_fixed(names: list[str]) -> None:
    looks = style.tracker_looks(names)
    assert len({look.colour for look in looks.values()}) == len(names)
    for name in set(names) & set(style.TRACKER_COLOURS):
        assert looks[name].colour == style.TRACKER_COLOURS[name]


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_eye_sees_the_whole_scene_and_not_much_else(aspect: float) -> None:
    points = np.random.default_rng(3).uniform((-1, 0, 0), (3, 2, 2.5), (40, 3))
    eye = eye_on(points[:15], points[15:], aspect=aspect)
    position = np.array(eye.position_m)
    z = (eye.target_m - position) / np.linalg.norm(eye.target_m - position)
    x = np.cross(z, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    T_map_eye = Pose(np.stack([x, np.cross(z, x), z], axis=1), position)
    seen = T_map_eye.inverse().apply(points)
    assert (seen[:, 2] > 0).all()
    # 1 is the edge of a view that spans 55 degrees from bottom to top.
    share = np.abs(seen[:, :2] / seen[:, 2:]) / np.tan(np.radians(27.5)) / (aspect, 1.0)
    assert 0.75 < share.max() < 1.0


def test_layout_survives_json() -> None:
    eye = eye_on(np.eye(3), aspect=1.0)
    layout = ResultLayout("a/b", ("min",), ("error", "nis"), {"min": 0.5}, 7, eye)
    assert ResultLayout.from_json(layout.to_json()) == layout


def test_a_damaged_recording_in_an_overlay_is_one_line(tmp_path: Path) -> None:
    log = worlds.small_log(tmp_path / "a.mcap", 3)
    for name in ("one", "two"):
        replay(log, tmp_path / name, name, ReplayOptions(progress=False))
    (tmp_path / "two/replay.rrd").write_bytes(b"not a recording")
    with pytest.raises(InputError, match="expected a Rerun recording"):
        view([tmp_path / "one", tmp_path / "two"], save=tmp_path / "both.rrd")
    assert not (tmp_path / "both.rrd").exists()
