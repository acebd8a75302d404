"""Derivatives for bundle adjustment: of projection, of rotation, and of shrunken corners."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera
from pipeline.geometry import Array

_ZERO = np.zeros(3)


def project_with_jacobian(camera: Camera, points_m: npt.ArrayLike) -> tuple[Array, Array]:
    """Pixels (N, 2) of points (N, 3) of the camera frame, and their derivatives (N, 2, 3).

    Unlike `Camera.project` also behind the camera, where the numbers are finite and no pixels: an
    optimizer that strays there needs a way back.
    """
    points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 1, 3)
    if not len(points):
        return np.empty((0, 2)), np.empty((0, 2, 3))
    if camera.distortion_model == "equidistant":
        pixels, jacobian = cv2.fisheye.projectPoints(
            points, _ZERO, _ZERO, camera.camera_matrix, camera.dist_coeffs
        )
        # OpenCV's columns: focal lengths 2, principal point 2, coefficients 4, rotation 3.
        first = 11
    else:
        pixels, jacobian = cv2.projectPoints(
            points, _ZERO, _ZERO, camera.camera_matrix, camera.dist_coeffs
        )
        first = 3
    # Translated by t, a point p is at p + t: the derivative by t is that by the point.
    by_point = np.asarray(jacobian, dtype=np.float64)[:, first : first + 3].reshape(-1, 2, 3)
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), by_point


def cross_matrices(vectors: Array) -> Array:
    """(..., 3, 3) matrices [v] with [v] w = v x w."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotations(rvecs: Array) -> tuple[Array, Array]:
    """Exp(v) (N, 3, 3) of axis-angles (N, 3), and left Jacobians (N, 3, 3).

    For a small d, Exp(v + d) = Exp(J d) Exp(v): so d(Exp(v) a)/dv = -[Exp(v) a] J.
    Source: Solà, Deray, Atchuthan, A micro Lie theory, 2018, (134), (145).
    """
    squares = np.einsum("ni,ni->n", rvecs, rvecs)
    angle = np.sqrt(squares)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0 - squares / 6.0, np.sin(safe) / safe)
    cosine = np.where(small, 0.5 - squares / 24.0, (1.0 - np.cos(safe)) / safe**2)
    cubic = np.where(small, 1.0 / 6.0 - squares / 120.0, (safe - np.sin(safe)) / safe**3)
    cross = cross_matrices(rvecs)
    twice = cross @ cross
    eye = np.eye(3)
    exp = eye + sine[:, None, None] * cross + cosine[:, None, None] * twice
    jacobian = eye + cosine[:, None, None] * cross + cubic[:, None, None] * twice
    return exp, jacobian


def inward_px(corners_px: Array) -> Array:
    """(N, 4, 2): how the corners (N, 4, 2) move when all four edges move inwards by one pixel."""
    ahead = np.roll(corners_px, -1, axis=1) - corners_px
    ahead = ahead / np.linalg.norm(ahead, axis=2, keepdims=True)
    back = -np.roll(ahead, 1, axis=1)
    sine = np.abs(ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0])
    # A corner seen edge-on would move far; such a detection is not worth the precision.
    return np.asarray((ahead + back) / np.maximum(sine, 0.2)[..., None])
