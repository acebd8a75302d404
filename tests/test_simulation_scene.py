"""Scenes: what they say, what is wrong with them, and the frames they give."""

from __future__ import annotations

import copy
import importlib.util
import os
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from pipeline.markers import load_dictionary
from recorder.errors import InputError
from recorder.files.truth_file import parse_truth
from recorder.simulation.compilation import is_kept
from recorder.simulation.scene_file import Scene, load_scene, shipped_scenes
from recorder.simulation.source import SceneSource
from recorder.sources.base import CapturedFrame, Source, SourceEvent

SCENES = shipped_scenes()

SMALL: dict[str, Any] = {
    "seed": 4,
    "rate_hz": 30,
    "frames": 7,
    "start": 1_700_000_000_123_456_789,
    "camera": {"width_px": 160, "height_px": 120, "diagonal_fov_deg": 80.0},
    "map": {
        "dictionary": "DICT_4X4_50",
        "size_m": 0.2,
        "markers": [
            {"id": 0, "xyz_m": [0.0, 0.0, 1.0], "yaw_deg": 0, "facing": "down"},
            {"id": 1, "xyz_m": [0.35, 0.1, 1.0], "yaw_deg": 30, "facing": "down", "std_m": 0.01},
        ],
    },
    "trajectory": {
        "kind": "waypoints",
        "looking": "up",
        "points": [{"t_s": 0, "xyz_m": [0, 0, 0]}, {"t_s": 1, "xyz_m": [0.3, 0, 0]}],
    },
    "image": {"noise_std": 2.0, "exposure_s": 0.02, "jpeg_quality": 80},
    "surface": {"height_m": 1.0, "texture": "plain"},
}


def captured(source: SceneSource) -> list[CapturedFrame]:
    """The frames, without the events between them."""
    return [frame for frame in source.frames() if isinstance(frame, CapturedFrame)]


def changed(**changes: Any) -> dict[str, Any]:
    """The small scene with keys set (`image__blur_px=1`) or, with None, removed."""
    scene = copy.deepcopy(SMALL)
    for name, value in changes.items():
        *path, key = name.split("__")
        at = scene
        for part in path:
            at = at[part]
        if value is None:
            del at[key]
        else:
            at[key] = value
    return scene


def write(folder: Path, scene: dict[str, Any], name: str = "small.yaml") -> Path:
    path = folder / name
    path.write_text(yaml.safe_dump(scene))
    return path


def in_full_view(scene: Scene, t_s: float) -> set[int]:
    """Ids whose four corners project into the image, on their printed side."""
    pose = scene.pose(t_s)
    width, height = scene.camera.image_size
    seen = set()
    for marker in scene.true_map.markers:
        corners = scene.true_camera.project(pose.inverse().apply(marker.corners_m))
        inside = (corners > -0.5).all() and (corners < (width - 0.5, height - 0.5)).all()
        if inside and marker.normal @ (pose.translation - marker.centre_m) > 0:
            seen.add(marker.id)
    return seen


def detected(scene: Scene, data: bytes) -> set[int]:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape == scene.camera.image_size[::-1]
    detector = cv2.aruco.ArucoDetector(load_dictionary(scene.marker_map.dictionary))
    _, ids, _ = detector.detectMarkers(image)
    return set() if ids is None else {int(i) for i in np.ravel(ids)}


@pytest.mark.parametrize("name", SCENES)
def test_shipped_scene_shows_its_markers(name: str) -> None:
    source = SceneSource(SCENES[name], workers=1)
    frames = source.frames()
    first = next(frames)
    frames.close()
    assert isinstance(first, CapturedFrame)
    found = detected(source.scene, first.data)
    visible = in_full_view(source.scene, 0.0)
    assert found <= visible
    # In the hard scene some are hidden.
    assert len(found) >= (8 if name == "hard" else len(visible))
    assert set(source.attachments) == {"camera.yaml", "map.yaml", "truth.yaml"}
    assert source.scene.file.truth is not None


def test_configuration_1_shows_what_the_paper_saw() -> None:
    high = load_scene(SCENES["configuration_1_high"])
    low = load_scene(SCENES["configuration_1_low"])
    assert in_full_view(high, 0.0) == set(range(24))
    visible = in_full_view(low, 0.0)
    assert len(visible) == 16
    assert set(range(8)) < visible
    outer = {low.marker_map.by_id[i].tags for i in visible if i >= 8}
    counts = {
        tag: sum(tag in low.marker_map.by_id[i].tags for i in visible if i >= 8)
        for tag in ("rot90", "rot45", "rot22.5")
    }
    assert counts == {"rot90": 2, "rot45": 2, "rot22.5": 4}
    assert all("outer" in tags for tags in outer)
    classes = {tag: {m.id for m in low.marker_map.markers if tag in m.tags} for tag in counts}
    assert classes["rot90"] == {0, 2, 4, 6, 8, 12, 16, 20}
    assert classes["rot45"] == {1, 3, 5, 7, 10, 14, 18, 22}
    assert classes["rot22.5"] == set(range(9, 24, 2))
    assert low.camera.camera_matrix[0, 0] == 1360.2
    assert low.pose(0.0).translation.tolist() == [0.0, 0.06, 1.334]


@pytest.mark.parametrize("name", ["configuration_2", "sample"])
def test_five_markers_in_view_everywhere_on_the_rectangle(name: str) -> None:
    scene = load_scene(SCENES[name])
    times = [scene.time_s(i) for i in range(0, scene.frame_count, 5)]
    assert min(len(in_full_view(scene, t)) for t in times) >= 5
    start = scene.pose(0.0).translation
    path = np.array([scene.pose(t).translation for t in times])
    assert start[1] == path[:, 1].max()


def test_configuration_2_is_as_slow_as_the_paper_needs() -> None:
    scene = load_scene(SCENES["configuration_2"])
    assert scene.frame_count == 2000
    assert scene.file.rate_hz == 10
    corners = [scene.pose(t).translation[:2].tolist() for t in (0, 60, 100, 160, 200)]
    np.testing.assert_allclose(corners, [[3, 2], [0, 2], [0, 0], [3, 0], [3, 2]], atol=1e-9)


@pytest.mark.parametrize("name", ["configuration_2", "sample", "hard"])
def test_told_path_holds_the_exact_one(name: str) -> None:
    scene = load_scene(SCENES[name])
    truth = parse_truth(scene.attachments["truth.yaml"], scene.path)
    assert truth.path is not None
    points = truth.path.points_m
    ends = np.roll(points, -1, axis=0) if truth.path.closed else points[1:]
    for i in range(0, scene.frame_count, 10):
        place = scene.pose(scene.time_s(i)).translation[:2]
        distances = []
        for a, b in zip(points, ends, strict=False):
            share = np.clip((place - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            distances.append(np.linalg.norm(place - a - share * (b - a)))
        assert min(distances) < truth.path.std_m


@pytest.mark.parametrize("name", ["sample", "configuration_1_low", "configuration_1_high"])
def test_told_standing_pose_is_near_the_exact_one_but_not_it(name: str) -> None:
    scene = load_scene(SCENES[name])
    (stood,) = parse_truth(scene.attachments["truth.yaml"], scene.path).poses
    for t_s in (stood.from_s, (stood.from_s + stood.to_s) / 2, stood.to_s):
        exact = scene.pose(t_s).translation[:2]
        error = np.hypot(*(exact - (stood.x_m, stood.y_m)))
        assert 0 < error < 2 * stood.std_m


def test_sample_log_stays_small() -> None:
    scene = load_scene(SCENES["sample"])
    source = SceneSource(SCENES["sample"])
    renderer = source.renderer()
    sizes = [len(source.render(renderer, i).data) for i in range(0, scene.frame_count, 15)]
    assert np.mean(sizes) * scene.frame_count < 6.7e6


def test_frames_are_the_same_whoever_renders_them(tmp_path: Path) -> None:
    path = write(tmp_path, SMALL)
    runs = [captured(SceneSource(path, workers)) for workers in (1, 2, 2)]
    for frames in runs:
        assert [f.frame_index for f in frames] == list(range(7))
        assert [f.data for f in frames] == [f.data for f in runs[0]]
    assert len({f.data for f in runs[0]}) == 7
    other = captured(SceneSource(write(tmp_path, changed(seed=5), "other.yaml")))
    assert all(a.data != b.data for a, b in zip(runs[0], other, strict=True))


def test_frames_carry_stamp_and_exact_pose(tmp_path: Path) -> None:
    source: Source = SceneSource(write(tmp_path, SMALL))
    frames = captured(SceneSource(write(tmp_path, SMALL)))
    assert source.frame_count() == len(frames) == 7
    assert source.image_size == (160, 120)
    assert source.name == "small"
    for i, frame in enumerate(frames):
        assert (
            frame.timestamp_ns
            == frame.arrival_ns
            == 1_700_000_000_123_456_789 + round(i * 1e9 / 30)
        )
        assert frame.format == "jpeg"
        assert frame.data.startswith(b"\xff\xd8")
        assert frame.T_map_camera is not None
        np.testing.assert_allclose(frame.T_map_camera.translation, (0.3 * i / 30, 0, 0), atol=1e-12)
    assert source.describe() == source.describe()
    assert source.describe()["seed"] == "4"


def test_png_keeps_every_grey_level(tmp_path: Path) -> None:
    source = SceneSource(write(tmp_path, changed(image__encoding="png", frames=1)))
    (frame,) = captured(source)
    assert frame.format == "png"
    image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_UNCHANGED)
    expected = source.renderer().capture(lambda dt_s: source.scene.pose(dt_s), 0)
    np.testing.assert_array_equal(image, expected)


def test_leaving_early_stops_the_rendering(tmp_path: Path) -> None:
    source = SceneSource(write(tmp_path, changed(frames=10_000)))
    frames = source.frames()
    next(frames)
    frames.close()


def test_what_is_told_differs_from_what_is_true_by_the_errors(tmp_path: Path) -> None:
    markers = [
        {"id": i, "xyz_m": [0.1 * i, 0.0, 1.0], "yaw_deg": 7.0 * i, "facing": "down"}
        for i in range(50)
    ]
    errors = {
        "marker_position_std_m": 0.004,
        "marker_yaw_std_deg": 0.5,
        "focal": 0.01,
        "principal_point_px": [2.0, -1.0],
    }
    scene = load_scene(write(tmp_path, changed(map__markers=markers, errors=errors)))
    again = load_scene(write(tmp_path, changed(map__markers=markers, errors=errors)))
    told, true = scene.marker_map, scene.true_map
    moved = np.array([true.by_id[i].centre_m - told.by_id[i].centre_m for i in told.ids])
    assert 0.003 < moved[:, :2].std() < 0.005
    np.testing.assert_allclose(moved[:, 2], 0.0, atol=1e-12)
    turned = np.array([true.by_id[i].T_map_marker.yaw_rad for i in told.ids]) - np.array(
        [told.by_id[i].T_map_marker.yaw_rad for i in told.ids]
    )
    turned = np.degrees((turned + np.pi) % (2 * np.pi) - np.pi)
    assert 0.35 < turned.std() < 0.65
    for a, b in zip(true.markers, again.true_map.markers, strict=True):
        np.testing.assert_array_equal(a.corners_m, b.corners_m)
    nominal, actual = scene.camera.camera_matrix, scene.true_camera.camera_matrix
    assert actual[0, 0] == pytest.approx(1.01 * nominal[0, 0])
    np.testing.assert_allclose(actual[:2, 2] - nominal[:2, 2], (2, -1))


def test_explicit_true_map_and_camera_are_rendered_and_not_told(tmp_path: Path) -> None:
    true_map = copy.deepcopy(SMALL["map"])
    true_map["markers"][0]["xyz_m"] = [0.01, 0.02, 1.03]
    true_camera = {"width_px": 160, "height_px": 120, "f_px": 123.0}
    scene = load_scene(write(tmp_path, changed(true_map=true_map, true_camera=true_camera)))
    assert scene.true_map.by_id[0].centre_m.tolist() == [0.01, 0.02, 1.03]
    assert scene.marker_map.by_id[0].centre_m.tolist() == [0.0, 0.0, 1.0]
    assert scene.true_camera.camera_matrix[0, 0] == 123.0
    assert scene.camera.camera_matrix[0, 0] == pytest.approx(100 / np.tan(np.radians(40)))
    assert b"1.03" not in scene.attachments["map.yaml"]


def test_named_files_are_told_byte_for_byte(tmp_path: Path) -> None:
    text = b"# by hand\n" + yaml.safe_dump(SMALL["map"]).encode()
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "map.yaml").write_bytes(text)
    scene = load_scene(write(tmp_path, changed(map="site/map.yaml")))
    assert scene.attachments["map.yaml"] == text
    assert scene.marker_map.ids == (0, 1)


@pytest.mark.parametrize(
    ("start", "expected_ns"),
    [
        ("2025-01-15T09:30:00Z", 1_736_933_400_000_000_000),
        ("2025-01-15T10:30:00.250+01:00", 1_736_933_400_250_000_000),
        ("2025-01-15 09:30:00", 1_736_933_400_000_000_000),
        ("17", 17),
    ],
)
def test_start_is_a_stamp_or_nanoseconds(tmp_path: Path, start: str, expected_ns: int) -> None:
    text = yaml.safe_dump(changed(start=None)) + f"start: {start}\n"
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    assert load_scene(path).timestamp_ns(0) == expected_ns
    path.write_text(yaml.safe_dump(changed(start=None)) + f"start: '{start}'\n")
    if start != "17":
        assert load_scene(path).timestamp_ns(0) == expected_ns


def test_frame_count_follows_duration_or_trajectory(tmp_path: Path) -> None:
    assert load_scene(write(tmp_path, changed(frames=None))).frame_count == 30
    assert load_scene(write(tmp_path, changed(frames=None, duration_s=2.5))).frame_count == 75


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (changed(sede=3), r"small\.yaml: sede: expected a known key, found 'sede'.*seed"),
        (changed(image__nois_std=3), r"image\.nois_std: expected a known key.*noise_std"),
        (changed(image__jpeg_quality=500), r"image\.jpeg_quality: expected .*100.*found 500"),
        (changed(camera=None), r"camera: expected this key, found none"),
        (
            changed(camera=3),
            r"\.yaml: camera: expected a path or the content of a camera.yaml, found 3$",
        ),
        (
            changed(map=[1]),
            r"\.yaml: map: expected a path or the content of a map.yaml, found \[1\]$",
        ),
        (
            changed(truth=False),
            r"\.yaml: truth: expected a path or the content of a truth.yaml, found False$",
        ),
        (
            changed(true_map={1: 2}),
            r"\.yaml: true_map: expected a path or the content of a map.yaml, found \{1: 2\}$",
        ),
        (changed(camera="nowhere.yaml"), r"nowhere\.yaml: expected a file, found none"),
        (changed(camera__f_px=100.0), r"camera: expected one of f_px and diagonal_fov_deg"),
        (changed(camera__width_px="wide"), r"camera\.width_px: expected .*integer, found 'wide'"),
        (changed(camera__dist_coeffs=[0.1]), r"camera: expected 4 or 5 coefficients.*found 1"),
        (changed(map__dictionary="DICT_9X9"), r"map.dictionary: expected a dictionary.*'DICT_9X9'"),
        (changed(map__markers=[{"id": 0}]), r"map\.markers\[0\].*expected one way to place it"),
        (changed(truth={"paths": {}}), r"truth\.paths: expected a known key"),
        (changed(trajectory__kind="spiral"), r"trajectory.*expected .*static.*found spiral"),
        (changed(trajectory__looking="left"), r"trajectory\.looking: expected 'up' or 'down'"),
        (changed(duration_s=3.0), r"expected frames or duration_s, found both"),
        (changed(start="yesterday"), r"expected start .*found 'yesterday'"),
        (
            changed(true_camera={"width_px": 80, "height_px": 60, "f_px": 50.0}),
            r"true_camera: expected the image size of camera, found 80x60",
        ),
        (
            changed(errors={"focal": 0.1}, true_camera=SMALL["camera"]),
            r"expected true_camera or errors of the camera, found both",
        ),
        (
            changed(
                frames=None, trajectory={"kind": "static", "looking": "up", "xyz_m": [0, 0, 0]}
            ),
            r"expected frames or duration_s for a static camera, found none",
        ),
    ],
)
def test_a_wrong_scene_gives_one_clear_line(
    tmp_path: Path, scene: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load_scene(write(tmp_path, scene))
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(tmp_path))


def test_a_missing_or_empty_scene_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a file, found none"):
        load_scene(tmp_path / "none.yaml")
    (tmp_path / "empty.yaml").write_text("")
    with pytest.raises(InputError, match="expected keys and values, found nothing"):
        load_scene(tmp_path / "empty.yaml")


def test_nothing_given_is_nothing_said(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump({**SMALL, "truth": None, "true_map": None}))
    assert set(load_scene(path).attachments) == {"camera.yaml", "map.yaml"}


def test_the_first_frame_is_said_to_wait_for_the_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = SceneSource(write(tmp_path, SMALL))
    captured(source)
    assert source.preparation() is None
    monkeypatch.setattr("recorder.simulation.renderer.is_kept", lambda function: False)
    assert "compiling the renderer" in (source.preparation() or "")


def test_machine_code_is_kept_until_its_source_changes(tmp_path: Path) -> None:
    path = tmp_path / "kernel.py"
    path.write_text(
        "from recorder.simulation.compilation import compiled\n\n\n"
        "@compiled\ndef twice(x):\n    return 2 * x\n"
    )
    specification = importlib.util.spec_from_file_location("kernel", path)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    assert not is_kept(module.twice)
    assert module.twice(2) == 4
    assert is_kept(module.twice)
    later_s = time.time() + 60
    os.utime(path, (later_s, later_s))
    assert not is_kept(module.twice)


@pytest.mark.bench
@pytest.mark.parametrize("name", ["configuration_1_high", "configuration_1_low"])
def test_speed_of_a_scene(name: str) -> None:
    source = SceneSource(SCENES[name])
    frames = source.frames()
    next(frames)
    begin = time.perf_counter()
    count = sum(1 for _ in frames)
    rate = count / (time.perf_counter() - begin)
    print(f"\n{name}: {rate:.1f} frames/s")
    assert rate > 1.0


def test_lost_frames_are_a_gap_and_events_come_in_their_place(tmp_path: Path) -> None:
    scene = changed()
    scene["dropped_frames"] = [2, 3]
    scene["events"] = [
        {"t_s": 0.18, "message": "late", "level": "warning"},
        {"t_s": 0.05, "message": "early"},
    ]
    source = SceneSource(write(tmp_path, scene))
    kept = captured(source)
    assert [frame.frame_index for frame in kept] == [0, 1, 4, 5, 6]
    assert source.frame_count() == 5
    whole = captured(SceneSource(write(tmp_path, SMALL, "whole.yaml")))
    assert kept[2].data == whole[4].data
    order = [
        item.message if isinstance(item, SourceEvent) else item.frame_index
        for item in source.frames()
    ]
    assert order == [0, 1, "early", 4, 5, "late", 6]
