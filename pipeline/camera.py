"""The calibrated camera: projection with lens distortion, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array, read_only

DistortionModel = Literal["plumb_bob", "rational_polynomial", "equidistant"]

# How many coefficients each model takes, in OpenCV's order.
COEFFICIENT_COUNTS: dict[DistortionModel, tuple[int, ...]] = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
}

# Fixed-point iterations of the inverse distortion; strong lenses need some dozens.
_UNDISTORT_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
_ROUND_TRIP_PX = 0.01
_ZERO = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with lens distortion; pixel centres are at integer coordinates.

    Attributes:
        camera_matrix: (3, 3), pixels.
        dist_coeffs: (N,) in OpenCV's order; `equidistant` is OpenCV's fisheye model.
    """

    width_px: int
    height_px: int
    camera_matrix: Array
    distortion_model: DistortionModel
    dist_coeffs: Array
    name: str = "camera"

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera_matrix", read_only(self.camera_matrix, (3, 3)))
        object.__setattr__(self, "dist_coeffs", read_only(self.dist_coeffs, (-1,)))
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError(
                f"expected a positive image size, found {self.width_px}x{self.height_px}"
            )
        if self.distortion_model not in get_args(DistortionModel):
            raise ValueError(
                f"expected a distortion model of {', '.join(get_args(DistortionModel))}, "
                f"found {self.distortion_model!r}"
            )
        counts = COEFFICIENT_COUNTS[self.distortion_model]
        if len(self.dist_coeffs) not in counts:
            raise ValueError(
                f"expected {' or '.join(map(str, counts))} coefficients for "
                f"{self.distortion_model}, found {len(self.dist_coeffs)}"
            )
        if not (np.isfinite(self.camera_matrix).all() and np.isfinite(self.dist_coeffs).all()):
            raise ValueError("expected finite intrinsics, found NaN or infinity")
        k = self.camera_matrix
        if k[0, 0] <= 0 or k[1, 1] <= 0 or not np.array_equal(k[2], (0.0, 0.0, 1.0)):
            raise ValueError("expected a camera matrix with positive fx, fy and last row 0 0 1")

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width_px, self.height_px

    @property
    def image_centre_px(self) -> Array:
        """(2,) centre of the image area (not the principal point)."""
        return np.array([(self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0])

    def project(self, points_m: npt.ArrayLike) -> Array:
        """Points (N, 3) of the camera frame to distorted pixels (N, 2); NaN behind the camera."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        if not len(points):
            return np.empty((0, 2))
        # OpenCV divides by z without a look at its sign.
        visible = points[:, 2] > 0
        safe = np.where(visible[:, None], points, (0.0, 0.0, 1.0))
        if self.distortion_model == "equidistant":
            pixels, _ = cv2.fisheye.projectPoints(
                safe[:, None, :], _ZERO, _ZERO, self.camera_matrix, self.dist_coeffs
            )
        else:
            pixels, _ = cv2.projectPoints(safe, _ZERO, _ZERO, self.camera_matrix, self.dist_coeffs)
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        pixels[~visible] = np.nan
        return pixels

    def undistort(self, pixels: npt.ArrayLike) -> Array:
        """Distorted pixels (N, 2) to normalized image coordinates (N, 2): the ray is (x, y, 1).

        NaN where no ray in front of the camera gives the pixel: beyond what the model can invert,
        and at 90° or more off the axis of a fisheye lens.
        """
        points = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        if not len(points):
            return np.empty((0, 2))
        if self.distortion_model == "equidistant":
            normalized = cv2.fisheye.undistortPoints(
                points, self.camera_matrix, self.dist_coeffs, criteria=_UNDISTORT_CRITERIA
            )
        else:
            normalized = cv2.undistortPoints(
                points, self.camera_matrix, self.dist_coeffs, criteria=_UNDISTORT_CRITERIA
            )
        rays = np.asarray(normalized, dtype=np.float64).reshape(-1, 2)
        again = self.project(np.column_stack([rays, np.ones(len(rays))]))
        # OpenCV returns its last guess also where it found no answer.
        lost = ~(np.abs(again - points[:, 0]).max(axis=1) < _ROUND_TRIP_PX)
        rays[lost] = np.nan
        return rays
