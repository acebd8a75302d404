"""What a batch is solved from, and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.batch.subsets import Index
from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array, wrap_angle
from pipeline.markers import MarkerMap

BoolArray: TypeAlias = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class BatchPoses:
    """Camera poses T_map_camera, one a subset; NaN where there is none.

    Attributes:
        positions_m: (M, 3).
        quats_xyzw: (M, 4) rotations, w >= 0.
        yaw_rad: (M,) heading of the camera's x axis in the map, in (-pi, pi].
        reprojection_rms_px: (M,) over all corners of the subset.
        converged: (M,) the batch reached its minimum, or OpenCV's call succeeded.
        by_opencv: (M,) OpenCV's call gave the pose.
    """

    positions_m: Array
    quats_xyzw: Array
    yaw_rad: Array
    reprojection_rms_px: Array
    converged: BoolArray
    by_opencv: BoolArray

    def __len__(self) -> int:
        return len(self.positions_m)


@dataclass(frozen=True, eq=False)
class Problem:
    """What the solvers see of an image.

    Attributes:
        object_points: (N, 4, 3) in the map.
        pixels: (N, 4, 2) distorted; of an equidistant lens, as an ideal lens would give them.
        rays: (N, 4, 2) undistorted normalized image coordinates.
        dist_coeffs: those that belong to `pixels`.
        lens: (16,) for `pipeline.batch.refine`; None where it lacks the model.
    """

    object_points: Array
    pixels: Array
    rays: Array
    camera_matrix: Array
    dist_coeffs: Array | None
    lens: Array | None

    @classmethod
    def of(cls, detections: Detections, camera: Camera, marker_map: MarkerMap) -> Problem:
        """Raises ValueError without detections, or where the map lacks one."""
        if not len(detections):
            raise ValueError("expected at least one detection, found none")
        unknown = sorted({int(i) for i in detections.ids} - set(marker_map.ids))
        if unknown:
            raise ValueError(f"expected markers of the map, found {unknown}")
        object_points = marker_map.corners_m(int(i) for i in detections.ids).reshape(-1, 4, 3)
        pixels = np.array(detections.corners_px, dtype=np.float64)
        rays = camera.undistort(pixels.reshape(-1, 2)).reshape(-1, 4, 2)
        K, coefficients = np.array(camera.camera_matrix), np.array(camera.dist_coeffs)
        lens = np.zeros(16)
        lens[:4] = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
        if camera.distortion_model == "equidistant":
            # As in `pipeline.pose`: OpenCV's solvers know no fisheye.
            ideal = rays @ K[:2, :2].T + K[:2, 2]
            return cls(object_points, ideal, rays, K, None, lens)
        lens[4 : 4 + len(coefficients[:12])] = coefficients[:12]
        tilted = bool(coefficients[12:].any())
        return cls(object_points, pixels, rays, K, coefficients, None if tilted else lens)


@dataclass(frozen=True, eq=False)
class Results:
    """`BatchPoses` while they are written to, some rows at a time."""

    positions_m: Array
    quats_xyzw: Array
    yaw_rad: Array
    reprojection_rms_px: Array
    converged: BoolArray
    by_opencv: BoolArray

    @classmethod
    def empty(cls, m: int) -> Results:
        return cls(
            positions_m=np.full((m, 3), np.nan),
            quats_xyzw=np.full((m, 4), np.nan),
            yaw_rad=np.full(m, np.nan),
            reprojection_rms_px=np.full(m, np.nan),
            converged=np.zeros(m, np.bool_),
            by_opencv=np.zeros(m, np.bool_),
        )

    def write(self, rows: Index | slice, R_camera_map: Array, t: Array, rms_px: Array) -> None:
        """The poses of `rows` from extrinsics (m, 3, 3) and (m, 3)."""
        R_map_camera = R_camera_map.transpose(0, 2, 1)
        self.positions_m[rows] = -np.einsum("mij,mj->mi", R_map_camera, t)
        self.quats_xyzw[rows] = quaternions(R_map_camera)
        self.yaw_rad[rows] = wrap_angle(np.arctan2(R_map_camera[:, 1, 0], R_map_camera[:, 0, 0]))
        self.reprojection_rms_px[rows] = rms_px

    def finished(self) -> BatchPoses:
        for array in vars(self).values():
            array.flags.writeable = False
        return BatchPoses(**vars(self))


def reprojection_rms_px(problem: Problem, subsets: Index, R_camera_map: Array, t: Array) -> Array:
    """(M,) root mean square distance of the subsets' corners, by OpenCV's projection."""
    points = problem.object_points[subsets].reshape(len(subsets), -1, 3)
    points = np.einsum("mij,mcj->mci", R_camera_map, points) + t[:, None]
    projected, _ = cv2.projectPoints(
        points.reshape(-1, 3), np.zeros(3), np.zeros(3), problem.camera_matrix, problem.dist_coeffs
    )
    off = np.asarray(projected).reshape(-1, 2) - problem.pixels[subsets].reshape(-1, 2)
    squares = (off**2).sum(axis=1).reshape(len(subsets), -1)
    return np.asarray(np.sqrt(squares.mean(axis=1)))


def rotation_matrices(rvecs: Array) -> Array:
    """(M, 3, 3) of axis-angle vectors (M, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(rvecs, axis=1)
    x, y, z = (rvecs / np.where(angle > 0, angle, 1.0)[:, None]).T
    zero = np.zeros_like(angle)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * cross + (1 - c) * (cross @ cross))


def quaternions(rotations: Array) -> Array:
    """(M, 4) unit quaternions x, y, z, w >= 0 of rotation matrices (M, 3, 3) (Shepperd 1978)."""
    r = np.moveaxis(rotations, 0, -1)
    xy, xz, yz = r[1, 0] + r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    wx, wy, wz = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    rows = np.array(
        [
            [1 + r[0, 0] - r[1, 1] - r[2, 2], xy, xz, wx],
            [xy, 1 - r[0, 0] + r[1, 1] - r[2, 2], yz, wy],
            [xz, yz, 1 - r[0, 0] - r[1, 1] + r[2, 2], wz],
            [wx, wy, wz, 1 + r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    # The row with the largest diagonal element is the well-conditioned one.
    largest = np.argmax(np.einsum("iim->im", rows), axis=0)
    best = rows[largest, :, np.arange(len(rotations))]
    best = best / np.linalg.norm(best, axis=1)[:, None]
    return np.asarray(np.where(best[:, 3:] < 0, -best, best))
