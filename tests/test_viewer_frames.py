"""What single frames show: events on both timelines, no stale camera, no stale image."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.detection import Detections
from pipeline.localizer import Localizer, PipelineSettings
from pipeline.pose import PoseFix
from recorder.files.camera_file import camera_yaml
from recorder.files.map_file import map_yaml
from recorder.log.records import LogEvent, LogImage
from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame
from replay.viewer import style
from replay.viewer.program import has_graphics
from replay.viewer.raw import convert
from replay.viewer.recording import ReplayRecording
from replay.viewer.screenshot import screenshot
from tests import worlds
from tests.rrd_files import chunks, entities, rows

N_FRAMES = 8
MEASURED = (0.4, -0.2)
# Frames of the recording below: what became of them.
NO_MARKERS, REJECTED, UNDECODABLE = 0, 3, 5
SETTINGS = PipelineSettings()


def stamp(frame_index: int) -> int:
    return worlds.START_NS + frame_index * worlds.FRAME_NS


def jpeg() -> bytes:
    lens, marker_map = worlds.camera(ideal=True), worlds.ceiling()
    picture = worlds.draw(worlds.drive(1)[0], lens, marker_map)
    return bytes(cv2.imencode(".jpg", picture)[1])


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A replay with frames of every kind, events before, between and behind them."""
    path = tmp_path_factory.mktemp("frames") / "replay.rrd"
    lens, marker_map, data = worlds.camera(ideal=True), worlds.ceiling(), jpeg()
    localizer = Localizer(SETTINGS, lens, marker_map, worlds.START_NS)
    with ReplayRecording(
        path,
        log_id="5e" * 32,
        result_name="r",
        camera=lens,
        marker_map=marker_map,
        tracker_names=tuple(SETTINGS.trackers),
        start_ns=worlds.START_NS,
    ) as file:
        # Events may come long before the frame that they belong to.
        for name, event_ns in (("early", stamp(0) - 5), ("late", stamp(4) + 7), ("on", stamp(2))):
            file.log_event(LogEvent(event_ns, "info", "said", name))
        for i, pose in enumerate(worlds.drive(N_FRAMES)):
            seen: Detections | None = worlds.corners(pose, lens, marker_map)
            if i in (NO_MARKERS, UNDECODABLE):
                seen = Detections.none() if i == NO_MARKERS else None
            result = localizer.advance(i, stamp(i), seen)
            if i == REJECTED:
                fix = PoseFix("reprojection", T_map_camera=result.fix.T_map_camera)
                result = replace(result, fix=fix)
            image = LogImage(i, stamp(i), stamp(i), data, "jpeg")
            file.log_frame(image, result, measured=MEASURED if i % 2 else None)
        file.log_event(LogEvent(stamp(N_FRAMES) + 1, "info", "said", "end"))
    return path


def event_frames(path: Path) -> dict[str, int]:
    """The frame number of each of the log's events; each has its time too."""
    found: dict[str, int] = {}
    for chunk in chunks(path, style.EVENTS):
        assert set(chunk.timeline_names) == {style.FRAME, style.TIME}
        batch = chunk.to_record_batch()
        texts = [text[0] for text in batch.column("TextLog:text").to_pylist()]
        found.update(zip(texts, batch.column(style.FRAME).to_pylist(), strict=True))
    return {text.split(":")[0]: frame for text, frame in found.items()}


def test_events_are_listed_at_the_last_frame_before_them(recording: Path) -> None:
    assert event_frames(recording) == {"early": 0, "on": 2, "late": 4, "end": N_FRAMES - 1}


def test_events_of_a_log_alone_are_on_both_timelines(tmp_path: Path) -> None:
    log, lens, marker_map = tmp_path / "a.mcap", worlds.camera(ideal=True), worlds.ceiling()
    files = {"camera.yaml": camera_yaml(lens), "map.yaml": map_yaml(marker_map)}
    with LogWriter(log, attachments=files, session={"source": "test"}) as writer:
        for i, pose in enumerate(worlds.drive(4)):
            known = pose if i != 2 else None
            writer.write_frame(CapturedFrame(i, stamp(i), stamp(i), jpeg(), "jpeg", known))
            writer.write_event(stamp(i) + 10, "info", "said", name=f"after {i}")
    convert(log, tmp_path / "a.rrd")
    assert event_frames(tmp_path / "a.rrd") == {f"after {i}": i for i in range(4)}
    hidden = hidden_frames(tmp_path / "a.rrd", style.CAMERA)
    assert hidden == {2}


def test_an_image_that_is_not_whole_does_not_keep_the_last_one(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    with LogWriter(log, attachments={}, session={}) as writer:
        for i, data in enumerate([jpeg(), b"", jpeg()[:-100], jpeg()]):
            writer.write_frame(CapturedFrame(i, stamp(i), stamp(i), data, "jpeg"))
    convert(log, tmp_path / "a.rrd")
    blobs = rows(tmp_path / "a.rrd", style.IMAGE, "EncodedImage:blob")
    assert {frame for frame, blob in blobs.items() if not blob} == {1, 2}
    assert set(blobs) == {0, 1, 2, 3}


def hidden_frames(path: Path, entity: str) -> set[int]:
    """Frames whose camera is nowhere."""
    positions = rows(path, entity, "Transform3D:translation")
    return {frame for frame, value in positions.items() if np.isnan(value[0]).all()}


@pytest.mark.parametrize("entity", [style.CAMERA, style.ResultPaths("r").camera])
def test_a_frame_without_a_pose_does_not_keep_the_last_ones(recording: Path, entity: str) -> None:
    assert hidden_frames(recording, entity) == {NO_MARKERS, REJECTED, UNDECODABLE}
    assert set(rows(recording, entity, "Transform3D:translation")) == set(range(N_FRAMES))


def test_an_undecodable_frame_does_not_keep_the_last_image(recording: Path) -> None:
    blobs = rows(recording, style.IMAGE, "EncodedImage:blob")
    assert set(blobs) == set(range(N_FRAMES))
    assert {frame for frame, blob in blobs.items() if not blob} == {UNDECODABLE}


def test_errors_are_against_the_measured_position_that_is_handed_in(recording: Path) -> None:
    entity = style.ResultPaths("r").plot("error", "raw fix")
    errors = rows(recording, entity, "Scalars:scalars")
    expected = {
        i: [pytest.approx(np.hypot(*(pose.translation[:2] - MEASURED)), abs=1e-4)]
        for i, pose in enumerate(worlds.drive(N_FRAMES))
        if i % 2 and i not in (REJECTED, UNDECODABLE)
    }
    assert errors == expected
    assert style.TRUTH_EXACT not in entities(recording)


@pytest.mark.skipif(not has_graphics(), reason="no Vulkan driver")
def test_the_viewer_shows_image_and_camera_only_where_they_are(
    recording: Path, tmp_path: Path
) -> None:
    def brightness(frame: int) -> tuple[float, float]:
        picture = tmp_path / f"{frame}.png"
        assert screenshot(recording, picture, at_frame=frame, size=(1280, 800)) == []
        image = cv2.imread(str(picture))
        assert image is not None
        # The scene is on the left of the upper part, the camera image on the right.
        light = image[60:440].min(axis=2) > 200
        return float(light[:, :760].mean()), float(light[:, 780:].mean())

    shown, rejected = brightness(1), brightness(REJECTED)
    assert rejected[0] < 0.95 * shown[0]
    assert shown[1] > 0.3
    assert rejected[1] > 0.3
