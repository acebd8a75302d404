"""The solver: exact poses from exact corners, the paper's very call, and every status."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.camera import Camera, DistortionModel
from pipeline.detection import Detections
from pipeline.geometry import Pose
from pipeline.markers import Marker, MarkerMap
from pipeline.pose import PoseFix, RansacIterative, judge
from tests import worlds


def solve(
    detections: Detections, solver: RansacIterative | None = None, time_s: float = 0.0
) -> PoseFix:
    return (solver or RansacIterative())(detections, worlds.camera(), worlds.ceiling(), time_s)


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "equidistant"])
@pytest.mark.parametrize("n_markers", [1, 2, 12])
def test_exact_corners_give_the_exact_pose(model: DistortionModel, n_markers: int) -> None:
    camera, marker_map = worlds.camera(model), worlds.ceiling()
    T_map_camera = worlds.looking_up(0.13, -0.21, 0.3, 2.1)
    # A level camera below a level ceiling is the degenerate frontal view: tilt it.
    T_map_camera = T_map_camera @ Pose.from_rvec_tvec((0.05, -0.08, 0.0), (0, 0, 0))
    seen = worlds.corners(T_map_camera, camera, marker_map)
    solver = RansacIterative(max_markers=n_markers, selection="largest")
    fix = solver(seen, camera, marker_map, 0.0)
    assert fix.status == "ok"
    assert fix.n_used == fix.n_explained == min(n_markers, len(seen))
    assert fix.T_map_camera is not None
    np.testing.assert_allclose(
        fix.T_map_camera.translation, T_map_camera.translation, atol=2e-4 if n_markers > 1 else 5e-3
    )
    assert fix.T_map_camera.yaw_rad == pytest.approx(T_map_camera.yaw_rad, abs=1e-3)


def test_the_default_is_the_papers_call_bit_for_bit() -> None:
    camera, marker_map = worlds.camera(), worlds.ceiling()
    for seed in range(20):
        seen = worlds.with_noise(
            worlds.corners(worlds.looking_up(0.1, 0.05 * seed % 0.3, 0.2), camera, marker_map),
            0.4,
            seed,
        )
        solved, rvec, tvec, _ = cv2.solvePnPRansac(
            np.concatenate([marker_map.by_id[int(i)].corners_m for i in seen.ids]),
            seen.corners_px.reshape(-1, 2),
            camera.camera_matrix,
            camera.dist_coeffs,
            flags=cv2.SOLVEPNP_ITERATIVE,
        )
        rotation, _ = cv2.Rodrigues(rvec)
        fix = solve(seen)
        assert solved
        assert fix.T_map_camera is not None
        assert np.array_equal(fix.T_map_camera.translation, -rotation.T @ tvec.ravel())
        assert np.array_equal(fix.T_map_camera.rotation, rotation.T)


def test_no_markers() -> None:
    fix = solve(Detections.none())
    assert (fix.status, fix.n_detected, fix.n_used) == ("no_markers", 0, 0)
    assert fix.T_map_camera is None


def seen_from(T_map_camera: Pose | None = None) -> Detections:
    return worlds.corners(
        T_map_camera or worlds.looking_up(0.1, 0.1), worlds.camera(), worlds.ceiling()
    )


def test_unknown_ids_are_counted_and_not_used() -> None:
    seen = seen_from()
    strangers = Detections(seen.ids + 500, seen.corners_px)
    fix = solve(strangers)
    assert (fix.status, fix.n_detected, fix.n_used) == ("unknown_ids", len(seen), 0)
    both = Detections(
        np.concatenate([seen.ids, strangers.ids[:1]]),
        np.concatenate([seen.corners_px, strangers.corners_px[:1] + 300]),
    )
    fix = solve(both)
    assert (fix.status, fix.n_detected, fix.n_used) == ("ok", len(seen) + 1, len(seen))


def test_two_markers_of_one_id_are_both_dropped() -> None:
    seen = seen_from()
    doubled = Detections(
        np.concatenate([seen.ids, seen.ids[:1]]),
        np.concatenate([seen.corners_px, seen.corners_px[:1] + 40.0]),
    )
    fix = solve(doubled)
    assert fix.status == "ok"
    assert seen.ids[0] not in fix.used_ids
    assert fix.n_used == len(seen) - 1
    fix = solve(doubled.select([0, len(seen)]))
    assert (fix.status, fix.n_detected, fix.n_used) == ("duplicate_ids", 2, 0)


def test_when_ransac_fails_the_plain_solver_takes_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cv2.solvePnPRansac", lambda *_, **__: (False, None, None, None))
    fix = solve(seen_from())
    assert fix.status == "ok"
    assert fix.fallback
    assert fix.T_map_camera is not None
    np.testing.assert_allclose(fix.T_map_camera.translation, (0.1, 0.1, 0.3), atol=1e-4)

    def raises(*_: Any, **__: Any) -> None:
        raise cv2.error("no")

    monkeypatch.setattr("cv2.solvePnPRansac", raises)
    monkeypatch.setattr("cv2.solvePnP", raises)
    fix = solve(seen_from())
    assert (fix.status, fix.T_map_camera) == ("solver_failed", None)
    assert fix.n_used > 0


def test_a_pose_that_is_not_finite_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    nan = np.full(3, np.nan)
    monkeypatch.setattr("cv2.solvePnPRansac", lambda *_, **__: (True, nan, nan, None))
    fix = solve(seen_from())
    assert (fix.status, fix.T_map_camera) == ("non_finite", None)


def test_a_camera_behind_the_markers_is_refused_and_keeps_its_numbers() -> None:
    """The same corners with a map that faces the other way: the mirror image of a pose."""
    camera, up = worlds.camera(), worlds.ceiling()
    flipped = MarkerMap(
        "map",
        up.dictionary,
        tuple(Marker.from_corners(m.id, m.corners_m[::-1]) for m in up.markers),
    )
    T_map_camera = worlds.looking_up(0.1, 0.1)
    seen = worlds.corners(T_map_camera, camera, up)
    reversed_corners = Detections(seen.ids, seen.corners_px[:, ::-1])
    fix = judge(T_map_camera, reversed_corners, camera, flipped, 5.0, n_detected=len(seen))
    assert fix.status == "behind_markers"
    assert fix.T_map_camera is not None
    assert fix.reprojection_rms_px < 1e-6


def test_reprojection_gate_counts_markers() -> None:
    camera, marker_map = worlds.camera(), worlds.ceiling()
    T_map_camera = worlds.looking_up(0.1, 0.1)
    seen = worlds.corners(T_map_camera, camera, marker_map)
    n = len(seen)

    def judged(n_moved: int, by_px: float) -> PoseFix:
        moved = seen.corners_px.copy()
        moved[:n_moved, :, 0] += by_px
        return judge(
            T_map_camera, Detections(seen.ids, moved), camera, marker_map, 5.0, n_detected=n
        )

    half = (n + 1) // 2
    fix = judged(half, 5.1)
    assert (fix.status, fix.n_explained) == ("reprojection", n - half)
    assert fix.reprojection_rms_px == pytest.approx(0.0, abs=1e-6)
    fix = judged((n - 1) // 2, 5.1)
    assert (fix.status, fix.n_explained) == ("ok", n - (n - 1) // 2)
    fix = judged(n, 4.9)
    assert (fix.status, fix.n_explained) == ("ok", n)
    assert fix.reprojection_rms_px == pytest.approx(4.9, abs=1e-6)
    fix = judged(n, 100)
    assert (fix.status, fix.n_explained) == ("reprojection", 0)
    assert np.isnan(fix.reprojection_rms_px)
    assert fix.reprojection_rms_used_px == pytest.approx(100)


def test_a_fisheye_marker_beyond_90_degrees_is_not_used() -> None:
    matrix = np.array([[300.0, 0, 639.5], [0, 300.0, 359.5], [0, 0, 1]])
    camera = Camera(1280, 720, matrix, "equidistant", np.zeros(4))
    marker_map = worlds.ceiling()
    T_map_camera = worlds.looking_up(0.1, 0.1)
    seen = worlds.corners(T_map_camera, camera, marker_map)
    moved = seen.corners_px.copy()
    moved[0] += (1240.0, 360.0) - moved[0].mean(axis=0)
    fix = RansacIterative()(Detections(seen.ids, moved), camera, marker_map, 0.0)
    assert fix.status == "ok"
    assert fix.used_ids == tuple(seen.ids[1:])
    assert fix.T_map_camera is not None
    np.testing.assert_allclose(fix.T_map_camera.translation, (0.1, 0.1, 0.3), atol=1e-3)
    alone = RansacIterative()(Detections(seen.ids[:1], moved[:1]), camera, marker_map, 0.0)
    assert (alone.status, alone.n_used) == ("solver_failed", 0)


def test_the_solver_survives_nonsense_corners() -> None:
    """Random, collapsed and far-away corners give a status, never an exception."""
    rng = np.random.default_rng(3)
    ids = np.array([0, 1, 2], dtype=np.int64)
    nonsense = [rng.uniform(0, 1280, (3, 4, 2)) for _ in range(50)]
    nonsense += [np.zeros((3, 4, 2)), np.full((3, 4, 2), 1e6), np.full((3, 4, 2), 640.0)]
    for corners in nonsense:
        for n in (1, 2, 3):
            fix = solve(Detections(ids[:n], corners[:n]))
            assert fix.status in (
                "ok",
                "solver_failed",
                "non_finite",
                "behind_markers",
                "reprojection",
            )
            assert (fix.T_map_camera is None) == (fix.status in ("solver_failed", "non_finite"))


@pytest.mark.parametrize("selection", ["nearest_center", "farthest_center", "largest", "lowest_id"])
def test_selection_takes_the_right_markers(selection: Any) -> None:
    camera = worlds.camera()
    seen = seen_from()
    fix = solve(seen, RansacIterative(max_markers=3, selection=selection))
    distance = np.linalg.norm(seen.corners_px.mean(axis=1) - (639.5, 359.5), axis=1)
    area = [cv2.contourArea(c.astype(np.float32)) for c in seen.corners_px]
    by = {
        "nearest_center": seen.ids[np.argsort(distance)[:3]],
        "farthest_center": seen.ids[np.argsort(-distance)[:3]],
        "largest": seen.ids[np.argsort(-np.array(area))[:3]],
        "lowest_id": np.sort(seen.ids)[:3],
    }
    assert sorted(fix.used_ids) == sorted(by[selection])
    assert camera.image_centre_px.tolist() == [639.5, 359.5]


def test_marker_limits_by_time() -> None:
    solver = RansacIterative.model_validate(
        {"max_markers": [{"until_s": 12, "n": 1}, {"until_s": 20, "n": 3}, {"n": None}]}
    )
    seen = seen_from()
    used = [solve(seen, solver, time_s).n_used for time_s in (0.0, 11.999, 12.0, 19.9, 20.0, 1e4)]
    assert used == [1, 1, 3, 3, len(seen), len(seen)]


@pytest.mark.parametrize(
    "spans",
    [
        [{"until_s": 5, "n": 1}, {"until_s": 5, "n": 2}],
        [{"until_s": 5, "n": 1}, {"until_s": 4, "n": 2}],
        [{"n": 1}, {"until_s": 4, "n": 2}],
    ],
)
def test_time_spans_that_do_not_grow_are_refused(spans: list[dict[str, float]]) -> None:
    with pytest.raises(ValueError, match="growing until_s"):
        RansacIterative.model_validate({"max_markers": spans})
