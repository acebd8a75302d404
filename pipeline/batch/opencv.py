"""The paper's call itself, one subset after another."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.batch.poses import Problem, Results, reprojection_rms_px, rotation_matrices
from pipeline.batch.subsets import Index
from pipeline.geometry import Array


def solve_by_opencv(problem: Problem, subsets: Index, rows: Index, out: Results) -> None:
    """Writes the results' `rows` by the call of `pipeline.pose.RansacIterative` with its defaults.

    Like there, plain `solvePnP` takes over where RANSAC fails.
    """
    rvecs, tvecs = np.full((len(rows), 3), np.nan), np.full((len(rows), 3), np.nan)
    for i, subset in enumerate(subsets[rows]):
        extrinsics = _solve(
            problem.object_points[subset].reshape(-1, 3),
            problem.pixels[subset].reshape(-1, 2),
            problem.camera_matrix,
            problem.dist_coeffs,
        )
        if extrinsics is not None:
            rvecs[i], tvecs[i] = extrinsics[0][:, 0], extrinsics[1][:, 0]
    R_camera_map = rotation_matrices(rvecs)
    rms_px = reprojection_rms_px(problem, subsets[rows], R_camera_map, tvecs)
    out.write(rows, R_camera_map, tvecs, rms_px)
    out.converged[rows] = np.isfinite(out.positions_m[rows]).all(axis=1)
    out.by_opencv[rows] = True


def _solve(
    object_points: Array, pixels: Array, camera_matrix: Array, dist_coeffs: Array | None
) -> tuple[Array, Array] | None:
    """rvec (3, 1) and tvec (3, 1) of T_camera_map."""
    try:
        solved, rvec, tvec, _ = cv2.solvePnPRansac(
            object_points, pixels, camera_matrix, dist_coeffs, flags=cv2.SOLVEPNP_ITERATIVE
        )
        if solved:
            return np.asarray(rvec, np.float64), np.asarray(tvec, np.float64)
    except cv2.error:
        pass
    try:
        solved, rvec, tvec = cv2.solvePnP(
            object_points, pixels, camera_matrix, dist_coeffs, flags=cv2.SOLVEPNP_ITERATIVE
        )
    except cv2.error:
        return None
    return (np.asarray(rvec, np.float64), np.asarray(tvec, np.float64)) if solved else None
