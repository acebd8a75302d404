"""Rigid transforms between frames: `T_a_b` maps coordinates of frame b into frame a."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]


def read_only(values: npt.ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """A float64 copy that cannot be written to.

    Raises:
        ValueError: the shape is another than `shape` (-1 there matches any length).
    """
    array = np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape)
        or any(want not in (-1, have) for want, have in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"expected shape {shape}, found {array.shape}")
    array.flags.writeable = False
    return array


def wrap_angle(angle_rad: npt.ArrayLike) -> Array:
    """Angles wrapped to (-pi, pi]."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid transform T_a_b: the pose of frame b in frame a, metres.

    Attributes:
        rotation: (3, 3) rotation matrix R_a_b.
        translation: (3,) origin of b in a.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", read_only(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", read_only(self.translation, (3,)))

    @classmethod
    def identity(cls) -> Self:
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rvec_tvec(cls, rvec: npt.ArrayLike, tvec: npt.ArrayLike) -> Self:
        """From OpenCV's extrinsics, axis-angle and translation, in any of its shapes."""
        rotation, _ = cv2.Rodrigues(np.asarray(rvec, dtype=np.float64).reshape(3))
        return cls(read_only(rotation), np.asarray(tvec, dtype=np.float64).reshape(3))

    @classmethod
    def from_quat(cls, xyz_m: npt.ArrayLike, quat_xyzw: npt.ArrayLike) -> Self:
        """From a position and a quaternion x, y, z, w, normalized here.

        Raises:
            ValueError: the quaternion has no length, or a shape is wrong.
        """
        x, y, z, w = unit_quaternion(quat_xyzw)
        rotation = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        return cls(np.array(rotation), np.asarray(xyz_m, dtype=np.float64))

    def __matmul__(self, other: Pose) -> Pose:
        """T_a_c = T_a_b @ T_b_c."""
        return Pose(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )

    def inverse(self) -> Pose:
        """T_b_a."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: npt.ArrayLike) -> Array:
        """Points (N, 3) of frame b in coordinates of frame a."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation

    @property
    def rvec(self) -> Array:
        """The rotation as OpenCV's axis-angle (3,)."""
        rvec, _ = cv2.Rodrigues(np.array(self.rotation))
        return np.asarray(rvec, dtype=np.float64).reshape(3)

    @property
    def yaw_rad(self) -> float:
        """Rotation of b's x axis about a's z axis, in (-pi, pi]."""
        return float(wrap_angle(np.arctan2(self.rotation[1, 0], self.rotation[0, 0])))

    @property
    def quat_xyzw(self) -> Array:
        """The rotation as a unit quaternion (4,) with w >= 0."""
        r = self.rotation
        # The largest of the four squared components gives the stable branch (Shepperd 1978).
        squares = np.array(
            [
                1 + r[0, 0] - r[1, 1] - r[2, 2],
                1 - r[0, 0] + r[1, 1] - r[2, 2],
                1 - r[0, 0] - r[1, 1] + r[2, 2],
                1 + r[0, 0] + r[1, 1] + r[2, 2],
            ]
        )
        xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
        wx, wy, wz = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        rows = (
            (squares[0], xy, xz, wx),
            (xy, squares[1], yz, wy),
            (xz, yz, squares[2], wz),
            (wx, wy, wz, squares[3]),
        )
        quaternion = unit_quaternion(rows[int(np.argmax(squares))])
        return -quaternion if quaternion[3] < 0 else quaternion

    def is_finite(self) -> bool:
        return bool(np.isfinite(self.rotation).all() and np.isfinite(self.translation).all())


def unit_quaternion(quat_xyzw: npt.ArrayLike) -> Array:
    """A quaternion (4,) scaled to length 1.

    Raises:
        ValueError: it has no length or is not four finite numbers.
    """
    quaternion = np.asarray(quat_xyzw, dtype=np.float64)
    if quaternion.shape != (4,):
        raise ValueError(f"expected a quaternion x, y, z, w, found shape {quaternion.shape}")
    length = float(np.linalg.norm(quaternion))
    if not np.isfinite(length) or length < 1e-9:
        raise ValueError("expected a quaternion of a length above zero")
    return quaternion / length


def rotation_z(angle_rad: float) -> Array:
    """(3, 3) rotation about z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
