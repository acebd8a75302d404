"""The batch solver: exact poses, minima nobody improves on, and OpenCV's call where it is asked."""

from __future__ import annotations

import subprocess
import sys
from itertools import combinations, islice
from math import comb
from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline import batch_pose
from pipeline.batch_pose import (
    BatchPoses,
    sample_subsets,
    solve_subsets,
    solve_subsets_opencv,
    subsets,
)
from pipeline.camera import Camera, DistortionModel
from pipeline.detection import ArucoDetection, Detections
from pipeline.geometry import Array, Pose
from pipeline.markers import Marker, MarkerMap
from pipeline.pose import RansacIterative
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.sources.base import CapturedFrame
from recorder.sources.opening import open_source
from tests import worlds

MODELS: tuple[DistortionModel, ...] = ("plumb_bob", "rational_polynomial", "equidistant")
LAYOUTS = ("plane", "millimetres", "heights", "walls")
AGREEMENT_M = 1e-4


def layout(name: str, seed: int = 0, count: int = 10) -> MarkerMap:
    """Markers above a camera: in a plane, nearly, at several heights, or on ceiling and wall."""
    rng = np.random.default_rng(seed)
    down = Pose.from_rvec_tvec((np.pi, 0, 0), (0, 0, 0))
    markers = []
    for i in range(count):
        xyz = np.array([rng.uniform(-1, 1), rng.uniform(-0.6, 0.6), 2.5])
        turn = Pose.from_rvec_tvec((0, 0, rng.uniform(-3, 3)), (0, 0, 0))
        if name == "millimetres":
            xyz[2] += rng.normal(0, 0.002)
            turn = turn @ Pose.from_rvec_tvec(rng.normal(0, 0.01, 3), (0, 0, 0))
        elif name == "heights":
            xyz[2] += rng.uniform(-0.4, 0.4)
        rotation = down.rotation @ turn.rotation
        if name == "walls" and i % 2:
            xyz = np.array([rng.uniform(-1, 1), 0.8, 2.5 + rng.uniform(-0.6, 0.6)])
            rotation = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ turn.rotation
        markers.append(Marker.from_pose(i, Pose(rotation, xyz), 0.15))
    return MarkerMap("map", "DICT_6X6_1000", tuple(markers))


def tilted(seed: int, max_deg: float = 25.0) -> Pose:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3) * (1, 1, 0)
    tilt = axis / np.linalg.norm(axis) * np.radians(rng.uniform(3, max_deg))
    level = worlds.looking_up(
        rng.uniform(-0.3, 0.3), rng.uniform(-0.2, 0.2), rng.uniform(-0.8, 0.2), rng.uniform(-3, 3)
    )
    return level @ Pose.from_rvec_tvec(tilt, (0, 0, 0))


@pytest.fixture(scope="module")
def rendered() -> tuple[Detections, Camera, MarkerMap, Pose]:
    """A frame of the paper's configuration I at 2.991 m, through the paper's detector."""
    source = open_source("configuration_1_high")
    files = dict(source.attachments)
    camera = parse_camera(files["camera.yaml"], Path("camera.yaml"))
    marker_map = parse_map(files["map.yaml"], Path("map.yaml"))
    frame = next(f for f in islice(source.frames(), 1) if isinstance(f, CapturedFrame))
    image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert frame.T_map_camera is not None
    detections = ArucoDetection().build(marker_map)(np.asarray(image, np.uint8))
    assert len(detections) == 24
    return detections, camera, marker_map, frame.T_map_camera


def distance_m(a: BatchPoses, b: BatchPoses) -> Array:
    return np.asarray(np.linalg.norm(a.positions_m - b.positions_m, axis=1))


def test_subsets_are_all_of_them_in_order() -> None:
    for n in range(1, 9):
        for size in range(1, n + 1):
            assert subsets(n, size).tolist() == [list(c) for c in combinations(range(n), size)]
    assert sum(comb(24, k) for k in range(1, 8)) == 536_154
    for size in (0, 4):
        with pytest.raises(ValueError, match="size from 1 to 3"):
            subsets(3, size)
        with pytest.raises(ValueError, match="size from 1 to 3"):
            sample_subsets(3, size, 1, 0)


def test_samples_are_different_subsets_each_as_likely() -> None:
    assert sample_subsets(6, 3, 20, 0).tolist() == subsets(6, 3).tolist()
    every = subsets(6, 3).tolist()
    # Few of them, nearly all, and very few.
    for count in (5, 17, 1):
        seen = np.zeros(len(every))
        for seed in range(300):
            sample = sample_subsets(6, 3, count, seed).tolist()
            places = [every.index(row) for row in sample]
            assert places == sorted(set(places))
            assert len(places) == count
            seen[places] += 1
        expected = 300 * count / 20
        assert np.abs(seen - expected).max() < 5 * np.sqrt(expected)
    many = sample_subsets(60, 7, 1000, 4)
    assert np.array_equal(many, sample_subsets(60, 7, 1000, 4))
    assert many.shape == np.unique(many, axis=0).shape == (1000, 7)
    assert (np.diff(many, axis=1) > 0).all()
    assert many.min() >= 0
    assert many.max() < 60


def lens(model: str) -> tuple[Array, Array]:
    """fx … s4 for the compiled model, and OpenCV's coefficients."""
    coefficients = np.array(
        {
            "plumb_bob": worlds.COEFFICIENTS["plumb_bob"],
            "rational": worlds.COEFFICIENTS["rational_polynomial"],
            "prism": (*worlds.COEFFICIENTS["rational_polynomial"], 2e-3, -1e-3, -3e-3, 1e-3),
        }[model]
    )
    numbers = np.zeros(16)
    numbers[:4] = 900, 905, 632.5, 365.2
    numbers[4 : 4 + len(coefficients)] = coefficients
    return numbers, coefficients


@pytest.mark.parametrize("model", ["plumb_bob", "rational", "prism"])
def test_normal_equations_are_those_of_opencvs_projection(model: str) -> None:
    """Cost, gradient and J^T J against `projectPoints` and central differences of it."""
    from pipeline.batch.refine import move, normal_equations

    rng = np.random.default_rng(2)
    numbers, coefficients = lens(model)
    K = np.array([[900.0, 0, 632.5], [0, 905.0, 365.2], [0, 0, 1]])
    points = np.concatenate([rng.uniform(-1, 1, (3, 12)), rng.uniform(0, 1000, (2, 12))])
    rotation = Pose.from_rvec_tvec((0.3, -0.2, 1.0), (0, 0, 0)).rotation
    pose = np.concatenate([rotation.ravel(), [0.2, -0.1, 3.0]])

    def residuals(pose: Array) -> Array:
        camera_frame = points[:3].T @ pose[:9].reshape(3, 3).T + pose[9:]
        pixels, _ = cv2.projectPoints(camera_frame, np.zeros(3), np.zeros(3), K, coefficients)
        return np.asarray((np.asarray(pixels).reshape(-1, 2) - points[3:].T).ravel())

    jacobian = np.empty((24, 6))
    for i in range(6):
        ends = []
        for h in (1e-6, -1e-6):
            moved = np.empty(12)
            move(pose, h * np.eye(6)[i], moved)
            assert np.linalg.det(moved[:9].reshape(3, 3)) == pytest.approx(1, abs=1e-14)
            ends.append(residuals(moved))
        jacobian[:, i] = (ends[0] - ends[1]) / 2e-6
    out = np.empty(27)
    cost = normal_equations(points, pose, numbers, out)
    r = residuals(pose)
    assert cost == pytest.approx(r @ r, rel=1e-12)
    np.testing.assert_allclose(out[:6], jacobian.T @ r, rtol=1e-6)
    H = jacobian.T @ jacobian
    np.testing.assert_allclose(out[6:], H[np.triu_indices(6)], rtol=1e-5, atol=1e-5 * H.max())
    pose[11] = -3.0
    assert normal_equations(points, pose, numbers, out) == np.inf


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("kind", LAYOUTS)
def test_exact_corners_give_the_exact_pose(model: DistortionModel, kind: str) -> None:
    camera, marker_map = worlds.camera(model), layout(kind)
    for seed in range(3):
        T_map_camera = tilted(seed)
        seen = worlds.corners(T_map_camera, camera, marker_map)
        for size in range(1, min(8, len(seen) + 1)):
            chosen = sample_subsets(len(seen), size, 20, seed)
            found = solve_subsets(seen, camera, marker_map, chosen, single_marker="least_squares")
            assert found.converged.all()
            assert not found.by_opencv.any()
            # The inverse of the fisheye is good to some 1e-7.
            error_m = np.abs(found.positions_m - T_map_camera.translation).max()
            assert error_m < (1e-6 if size > 1 else 2e-5)
            aligned = np.abs(found.quats_xyzw @ T_map_camera.quat_xyzw)
            np.testing.assert_allclose(aligned, 1, atol=1e-9)
            np.testing.assert_allclose(found.yaw_rad, T_map_camera.yaw_rad, atol=1e-5)
            assert found.reprojection_rms_px.max() < 1e-5


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("kind", LAYOUTS)
def test_opencv_finds_no_better_pose(model: DistortionModel, kind: str) -> None:
    """Where the two differ, the batch's reprojection error is the smaller one."""
    camera = worlds.camera(model)
    differ = larger = total = 0
    for seed in range(6):
        marker_map = layout(kind, seed)
        exact = worlds.corners(tilted(seed), camera, marker_map)
        seen = worlds.with_noise(exact, (0.2, 0.7, 1.2)[seed % 3], seed)
        for size in range(2, min(8, len(seen) + 1)):
            chosen = sample_subsets(len(seen), size, 20, seed)
            ours = solve_subsets(seen, camera, marker_map, chosen)
            theirs = solve_subsets_opencv(seen, camera, marker_map, chosen)
            apart = distance_m(ours, theirs) > AGREEMENT_M
            more = ours.reprojection_rms_px > theirs.reprojection_rms_px * (1 + 1e-7)
            differ += int(apart.sum())
            larger += int((apart & more).sum())
            total += len(chosen)
    assert total > 300
    assert larger == 0
    assert differ < 0.25 * total


def test_opencv_ends_at_the_same_pose_when_it_goes_on() -> None:
    """Its refinement, repeated from its own pose until it stands still, gives the batch's."""
    camera, marker_map = worlds.camera(), layout("plane", 1)
    seen = worlds.with_noise(worlds.corners(tilted(1), camera, marker_map), 0.7, 1)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    for size in (4, 6):
        chosen = sample_subsets(len(seen), size, 25, 0)
        found = solve_subsets(seen, camera, marker_map, chosen)
        for i, row in enumerate(chosen):
            points = marker_map.corners_m(int(n) for n in seen.ids[row])
            pixels = seen.corners_px[row].reshape(-1, 2)
            K, coefficients = np.array(camera.camera_matrix), np.array(camera.dist_coeffs)
            _, rvec, tvec = cv2.solvePnP(points, pixels, K, coefficients)
            for _ in range(60):
                rvec, tvec = cv2.solvePnPRefineLM(
                    points, pixels, K, coefficients, rvec, tvec, criteria
                )
            pose = Pose.from_rvec_tvec(rvec, tvec).inverse()
            np.testing.assert_allclose(found.positions_m[i], pose.translation, atol=2e-6)


def test_one_far_marker_gets_the_better_of_its_two_poses() -> None:
    """At least as good as both of IPPE's poses after their own refinement."""
    camera = worlds.camera()
    corners_m = Marker.from_yaw(0, (0, 0, 0), 0.0, "up", 0.15).corners_m
    marker_map = MarkerMap("map", "DICT_6X6_1000", (Marker.from_corners(0, corners_m),))
    K, coefficients = np.array(camera.camera_matrix), np.array(camera.dist_coeffs)
    two_minima = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        T_camera_marker = Pose.from_rvec_tvec(
            rng.normal((np.pi, 0, 0), 0.3), (rng.uniform(-0.5, 0.5), 0.1, 3.0)
        )
        pixels = camera.project(T_camera_marker.apply(corners_m)) + rng.normal(0, 0.5, (4, 2))
        seen = Detections(np.array([0]), pixels[None])
        found = solve_subsets(
            seen, camera, marker_map, np.array([[0]]), single_marker="least_squares"
        )
        _, rvecs, tvecs, _ = cv2.solvePnPGeneric(
            corners_m, pixels, K, coefficients, flags=cv2.SOLVEPNP_IPPE
        )
        rms = []
        for rvec, tvec in zip(rvecs, tvecs, strict=True):
            for _ in range(5):
                rvec, tvec = cv2.solvePnPRefineLM(
                    np.array(corners_m), pixels, K, coefficients, rvec, tvec
                )
            off = cv2.projectPoints(np.array(corners_m), rvec, tvec, K, coefficients)[0]
            rms.append(float(np.sqrt(((off.reshape(-1, 2) - pixels) ** 2).sum(axis=1).mean())))
        assert found.converged[0]
        assert found.reprojection_rms_px[0] <= min(rms) * (1 + 1e-6)
        two_minima += abs(rms[1] - rms[0]) > 1e-3
    assert two_minima > 20


def test_the_loop_is_the_paper_solver() -> None:
    camera, marker_map = worlds.camera(), worlds.ceiling()
    seen = worlds.with_noise(worlds.corners(tilted(3), camera, marker_map), 0.4, 3)
    for size in (1, 2, 5):
        chosen = sample_subsets(len(seen), size, 15, 1)
        loop = solve_subsets_opencv(seen, camera, marker_map, chosen)
        assert loop.by_opencv.all()
        for i, row in enumerate(chosen):
            fix = RansacIterative()(seen.select(row), camera, marker_map, 0.0)
            assert fix.T_map_camera is not None
            np.testing.assert_allclose(loop.positions_m[i], fix.T_map_camera.translation, atol=1e-9)
            assert abs(loop.quats_xyzw[i] @ fix.T_map_camera.quat_xyzw) == pytest.approx(1)
            assert loop.yaw_rad[i] == pytest.approx(fix.T_map_camera.yaw_rad, abs=1e-9)
            assert loop.reprojection_rms_px[i] == pytest.approx(fix.reprojection_rms_used_px)
        if size == 1:
            batch = solve_subsets(seen, camera, marker_map, chosen)
            assert batch.by_opencv.all()
            assert np.array_equal(batch.positions_m, loop.positions_m)


def test_outliers_are_left_to_opencv() -> None:
    camera, marker_map = worlds.camera(), layout("plane")
    seen = worlds.with_noise(worlds.corners(tilted(4), camera, marker_map), 0.2, 4)
    moved = seen.corners_px.copy()
    moved[0] += (60, -40)
    seen = Detections(seen.ids, moved)
    chosen = subsets(len(seen), 5)
    found = solve_subsets(seen, camera, marker_map, chosen)
    loop = solve_subsets_opencv(seen, camera, marker_map, chosen)
    spoiled = (chosen == 0).any(axis=1)
    assert np.array_equal(found.by_opencv, spoiled)
    assert np.array_equal(found.positions_m[spoiled], loop.positions_m[spoiled])
    assert distance_m(found, loop)[~spoiled].max() < 5e-3


def test_a_tilted_sensor_is_left_to_opencv() -> None:
    plain = worlds.camera("rational_polynomial")
    coefficients = np.array([*plain.dist_coeffs, 0, 0, 0, 0, 0.01, -0.02])
    camera = Camera(1280, 720, plain.camera_matrix, "rational_polynomial", coefficients)
    marker_map = layout("plane")
    seen = worlds.corners(tilted(5), camera, marker_map)
    found = solve_subsets(seen, camera, marker_map, subsets(len(seen), 3))
    assert found.by_opencv.all()
    np.testing.assert_allclose(
        found.positions_m, found.positions_m[:1].repeat(len(found), 0), atol=1e-2
    )
    straight = Camera(
        1280, 720, plain.camera_matrix, "rational_polynomial", coefficients * (np.arange(14) < 12)
    )
    seen = worlds.corners(tilted(5), straight, marker_map)
    assert not solve_subsets(seen, straight, marker_map, subsets(len(seen), 3)).by_opencv.any()


def test_nonsense_corners_give_a_pose_or_nan() -> None:
    camera, marker_map = worlds.camera(), layout("plane")
    rng = np.random.default_rng(3)
    ids = np.arange(3)
    nonsense = [rng.uniform(0, 1280, (3, 4, 2)) for _ in range(10)]
    nonsense += [np.zeros((3, 4, 2)), np.full((3, 4, 2), 1e6), np.full((3, 4, 2), 640.0)]
    for corners in nonsense:
        for size in (1, 2, 3):
            found = solve_subsets(Detections(ids, corners), camera, marker_map, subsets(3, size))
            finite = np.isfinite(found.positions_m).all(axis=1)
            assert np.array_equal(found.converged, finite)


def test_the_number_of_threads_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    camera, marker_map = worlds.camera("rational_polynomial"), layout("heights")
    seen = worlds.with_noise(worlds.corners(tilted(6), camera, marker_map), 2.0, 6)
    chosen = subsets(len(seen), 4)
    whole = solve_subsets(seen, camera, marker_map, chosen)
    monkeypatch.setattr(batch_pose, "CHUNK", 17)
    for threads in (1, 2, 3):
        counts: list[int] = []
        found = solve_subsets(
            seen, camera, marker_map, chosen, threads=threads, progress=counts.append
        )
        assert sum(counts) == len(chosen)
        for name, values in vars(whole).items():
            assert np.array_equal(getattr(found, name), values, equal_nan=True), name
            assert not values.flags.writeable


def test_rendered_frame_agrees_with_opencv(
    rendered: tuple[Detections, Camera, MarkerMap, Pose],
) -> None:
    detections, camera, marker_map, T_map_camera = rendered
    agree, counts = 0.0, 0
    for size in range(2, 8):
        chosen = sample_subsets(24, size, 500, size)
        ours = solve_subsets(detections, camera, marker_map, chosen)
        theirs = solve_subsets_opencv(detections, camera, marker_map, chosen)
        assert ours.converged.all()
        assert not ours.by_opencv.any()
        apart = distance_m(ours, theirs) > AGREEMENT_M
        assert not (apart & (ours.reprojection_rms_px > theirs.reprojection_rms_px)).any()
        if size > 2:
            agree += comb(24, size) * float(1 - apart.mean())
            counts += comb(24, size)
        assert np.median(np.abs(ours.positions_m - T_map_camera.translation)) < 0.1
    assert agree / counts > 0.97


def test_bad_arguments_are_refused() -> None:
    camera, marker_map = worlds.camera(), worlds.ceiling()
    seen = worlds.corners(worlds.looking_up(), camera, marker_map)
    strangers = Detections(seen.ids + 500, seen.corners_px)
    for solver in (solve_subsets, solve_subsets_opencv):
        with pytest.raises(ValueError, match="markers of the map, found"):
            solver(strangers, camera, marker_map, subsets(2, 1))
        with pytest.raises(ValueError, match="at least one detection"):
            solver(Detections.none(), camera, marker_map, subsets(2, 1))
        with pytest.raises(ValueError, match=r"shape \(M, k\)"):
            solver(seen, camera, marker_map, np.arange(3))
        for wrong in (-1, len(seen)):
            with pytest.raises(ValueError, match=f"found {wrong} to {wrong}"):
                solver(seen, camera, marker_map, np.array([[wrong]]))
        assert len(solver(seen, camera, marker_map, np.empty((0, 3), np.int64))) == 0


def test_numba_is_imported_late() -> None:
    code = "import sys, pipeline.batch_pose; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
