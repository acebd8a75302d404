"""What a calibration estimates: the intrinsics of each distortion model, and their derivatives."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera, DistortionModel
from pipeline.geometry import Array

PINHOLE = ("fx", "fy", "cx", "cy")
COEFFICIENTS: dict[DistortionModel, tuple[str, ...]] = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "rational_polynomial": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "equidistant": ("k1", "k2", "k3", "k4"),
}


@dataclass(frozen=True)
class Lens:
    """A distortion model, of which some coefficients may be left at zero."""

    model: DistortionModel
    zero: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name in sorted(self.zero):
            if name not in COEFFICIENTS[self.model]:
                raise ValueError(
                    f"expected a coefficient of {self.model} "
                    f"({', '.join(COEFFICIENTS[self.model])}), found {name!r}"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """All parameters, in the order of their values everywhere."""
        return PINHOLE + COEFFICIENTS[self.model]

    @property
    def free(self) -> npt.NDArray[np.bool_]:
        """(P,) which parameters are estimated."""
        return np.array([name not in self.zero for name in self.names])

    def without(self, names: Iterable[str]) -> Lens:
        return Lens(self.model, self.zero | frozenset(names))

    def camera(self, values: Array, image_size: tuple[int, int], name: str = "camera") -> Camera:
        """The camera of these parameters."""
        return Camera(*image_size, camera_matrix(values), self.model, values[4:], name)

    def project(
        self, values: Array, pose: Array, points_m: Array
    ) -> tuple[Array, Array, Array] | None:
        """Pixels of board points, and their derivatives; None with a point behind the camera.

        Args:
            values: (P,) the parameters.
            pose: (6,) axis-angle and translation of T_camera_board.
            points_m: (N, 3).

        Returns:
            (N, 2), by the parameters (2N, P), by the pose (2N, 6).
        """
        rotation, _ = cv2.Rodrigues(pose[:3])
        if not (points_m @ np.asarray(rotation)[2] + pose[5] > 0).all():
            return None
        points = points_m.reshape(-1, 1, 3)
        if self.model == "equidistant":
            pixels, jacobian = cv2.fisheye.projectPoints(
                points, pose[:3], pose[3:], camera_matrix(values), values[4:]
            )
            # OpenCV's columns: focal lengths, principal point, coefficients, rotation, translation.
            derivatives = np.asarray(jacobian, dtype=np.float64)
            by_values, by_pose = derivatives[:, :8], derivatives[:, 8:14]
        else:
            pixels, jacobian = cv2.projectPoints(
                points, pose[:3], pose[3:], camera_matrix(values), values[4:]
            )
            # OpenCV's columns: rotation, translation, focal lengths, principal point, coefficients.
            derivatives = np.asarray(jacobian, dtype=np.float64)
            by_values, by_pose = derivatives[:, 6:], derivatives[:, :6]
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), by_values, by_pose


def camera_matrix(values: Array) -> Array:
    fx, fy, cx, cy = values[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
