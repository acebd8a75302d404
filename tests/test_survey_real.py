"""Surveys of real cameras: real images of a printed board, and corners others have adjusted."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.localizer import PipelineSettings
from pipeline.markers import MarkerMap
from pipeline.pose import RansacIterative
from recorder.attachments import read_attachments
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import map_yaml, parse_map
from recorder.record import record
from recorder.sources.opening import open_source
from replay.survey.logs import survey_logs
from replay.survey.results import SurveyOptions
from replay.survey.sightings import Sighter, Sighting, Span
from replay.survey.survey import survey
from tests.test_survey import errors, misplaced, rms_m


@pytest.mark.slow
@pytest.mark.parametrize("number", range(4))
def test_moving_board(number: int, shared_data: Path, tmp_path: Path) -> None:
    """A printed board, whose markers are where they were printed, with a map 1 cm and 1° off."""
    folder = shared_data / "moving_board" / f"cam_{number}"
    files = read_attachments(folder / "camera.yaml", folder / "map.yaml", None)
    record(open_source(str(folder / "video.mp4")), tmp_path / "a.mcap", attachments=files)
    true = parse_map((folder / "map.yaml").read_bytes(), folder / "map.yaml")
    fixed = frozenset({min(true.ids), max(true.ids)})
    rough = misplaced(true, number, fixed=fixed)
    (tmp_path / "rough.yaml").write_bytes(map_yaml(rough))
    done = survey_logs(
        [tmp_path / "a.mcap"],
        None,
        tmp_path / "rough.yaml",
        PipelineSettings(),
        SurveyOptions(fixed),
        Span(progress=False),
    )
    before, after = rms_m(rough, true, fixed), rms_m(done.survey.refined, true, fixed)
    free = [m for m in done.survey.markers if not m.fixed]
    pulls = errors(done.survey.refined, true, fixed)[:, :3] / [m.shift_sigma_m for m in free]
    print(
        f"cam_{number}: {1e3 * before:.1f} -> {1e3 * after:.2f} mm ({before / after:.0f} times), "
        f"{done.survey.rms_before_px:.1f} -> {done.survey.rms_after_px:.2f} px, "
        f"errors over their sigma {np.sqrt((pulls**2).mean()):.1f}"
    )
    assert len(free) == 8
    assert before / after >= 5
    # The calibration's errors, which are not in it, included.
    assert np.sqrt((pulls**2).mean()) < 5


def corner_log(folder: Path) -> tuple[Camera, MarkerMap, list[Detections]]:
    camera = parse_camera((folder / "camera.yaml").read_bytes(), folder / "camera.yaml")
    adjusted = parse_map((folder / "map.yaml").read_bytes(), folder / "map.yaml")
    frames: dict[str, list[tuple[int, list[list[float]]]]] = {}
    with (folder / "detections.csv").open() as file:
        for row in csv.DictReader(file):
            corners = [[float(row[f"x{i}"]), float(row[f"y{i}"])] for i in range(4)]
            frames.setdefault(row["stamp"], []).append((int(row["id"]), corners))
    detections = [
        Detections(np.array([i for i, _ in seen]), np.array([c for _, c in seen]))
        for seen in frames.values()
    ]
    return camera, adjusted, detections


@pytest.mark.parametrize(
    ("name", "fixed", "every", "bound_m"),
    [
        ("test_16", frozenset({0, 4}), 3, 1e-4),
        pytest.param(
            "test_13", frozenset({6, 12, 46, 63}), 6, 4e-3, marks=pytest.mark.slow, id="test_13"
        ),
    ],
)
def test_corner_logs(
    name: str, fixed: frozenset[int], every: int, bound_m: float, shared_data: Path
) -> None:
    """From a map 1 cm and 1° off to that which TagSLAM's bundle adjustment made of the same log."""
    camera, adjusted, detections = corner_log(shared_data / "corner_logs" / name / "cam0")
    rough = misplaced(adjusted, 0, fixed=fixed)
    sighter = Sighter(camera, rough, fixed, RansacIterative())
    sightings: list[Sighting] = [
        sighting
        for i, found in enumerate(detections[::every])
        if (sighting := sighter(0, i, found)) is not None
    ]
    found = survey(sightings, camera, rough, SurveyOptions(fixed, max_frames=240 // every))
    seen = {m.id for m in found.markers}
    left_out = fixed | (set(adjusted.ids) - seen)
    compared = replace(adjusted, markers=tuple(m for m in adjusted.markers if m.id not in left_out))
    before, after = (rms_m(m, compared, left_out) for m in (rough, found.refined))
    print(
        f"{name}: {len(compared.markers)} markers, {1e3 * before:.1f} -> {1e3 * after:.3f} mm from "
        f"the reference, {found.rms_before_px:.2f} -> {found.rms_after_px:.3f} px"
    )
    assert len(found.groups) == 1
    assert after < bound_m < before
