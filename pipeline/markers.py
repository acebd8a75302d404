"""Where the markers are: the marker map and the three ways to place a marker in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Self

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array, Pose, read_only, rotation_z

Facing = Literal["up", "down"]

# OpenCV's order: top left, top right, bottom right, bottom left of the print; x right, y up.
CORNER_SIGNS = read_only([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])

# How far hand-measured corners may be from a plane square, as a share of its side.
SQUARE_TOLERANCE = 0.05


@dataclass(frozen=True, eq=False)
class Marker:
    """One marker in the map.

    Attributes:
        corners_m: (4, 3) in map coordinates; top left, top right, bottom right, bottom left
            of the print as `cv2.aruco.generateImageMarker` draws it.
        T_map_marker: frame with x to the marker's right, y up, z out of the printed face.
        size_m: side of the black square.
        std_m: uncertainty of its position, where it is known.
        tags: groups for analysis.
    """

    id: int
    corners_m: Array
    T_map_marker: Pose
    size_m: float
    std_m: float | None = None
    tags: tuple[str, ...] = ()

    @classmethod
    def from_pose(
        cls,
        id: int,
        T_map_marker: Pose,
        size_m: float,
        std_m: float | None = None,
        tags: tuple[str, ...] = (),
    ) -> Self:
        """From any pose.

        Raises:
            ValueError: the size is not positive.
        """
        if not size_m > 0:
            raise ValueError(f"expected a size above zero, found {size_m}")
        corners_m = T_map_marker.apply(CORNER_SIGNS * (size_m / 2.0))
        return cls(id, read_only(corners_m), T_map_marker, size_m, std_m, tags)

    @classmethod
    def from_yaw(
        cls,
        id: int,
        xyz_m: npt.ArrayLike,
        yaw_rad: float,
        facing: Facing,
        size_m: float,
        std_m: float | None = None,
        tags: tuple[str, ...] = (),
    ) -> Self:
        """Flat on a floor (`up`) or ceiling (`down`); yaw is its x axis' angle in the map."""
        T_map_marker = Pose(marker_rotation(yaw_rad, facing), np.asarray(xyz_m, dtype=np.float64))
        return cls.from_pose(id, T_map_marker, size_m, std_m, tags)

    @classmethod
    def from_corners(
        cls,
        id: int,
        corners_m: npt.ArrayLike,
        std_m: float | None = None,
        tags: tuple[str, ...] = (),
    ) -> Self:
        """From its four corners, kept exactly as they were measured.

        Raises:
            ValueError: they are not a plane square to within 5 % of its side.
        """
        corners = read_only(corners_m, (4, 3))
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.linalg.norm(sides, axis=1)
        diagonals = np.linalg.norm(corners[2:] - corners[:2], axis=1)
        size_m = float(lengths.mean())
        if not (np.isfinite(size_m) and size_m > 0):
            raise ValueError("expected four different corners")
        tolerance = SQUARE_TOLERANCE * size_m
        uneven = max(
            float(np.abs(lengths - size_m).max()),
            float(np.abs(diagonals - size_m * np.sqrt(2.0)).max()),
        )
        centre = corners.mean(axis=0)
        if uneven <= tolerance:
            # The nearest rotation to the mean of opposite sides (Procrustes).
            x = (corners[1] - corners[0]) + (corners[2] - corners[3])
            y = (corners[0] - corners[3]) + (corners[1] - corners[2])
            z = np.cross(x, y) / np.linalg.norm(x)
            u, _, vt = np.linalg.svd(np.stack([x, y, z], axis=1))
            rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
            uneven = float(np.abs((corners - centre) @ rotation[:, 2]).max())
        if uneven > tolerance:
            raise ValueError(
                "expected corners of a plane square (top left, top right, bottom right, "
                f"bottom left), found sides of {np.round(lengths, 4).tolist()} m"
            )
        return cls(id, corners, Pose(rotation, centre), size_m, std_m, tags)

    @property
    def centre_m(self) -> Array:
        """(3,) in map coordinates."""
        return self.T_map_marker.translation

    @property
    def normal(self) -> Array:
        """(3,) unit vector out of the printed face, in map coordinates."""
        return self.T_map_marker.rotation[:, 2]


@dataclass(frozen=True, eq=False)
class MarkerMap:
    """The markers of one site.

    Attributes:
        frame: name of the map frame.
        dictionary: a name of `cv2.aruco`, such as DICT_6X6_1000.
        inverted: printed white on black.

    Raises:
        ValueError: an unknown dictionary, an id twice or outside the dictionary, or no markers.
    """

    frame: str
    dictionary: str
    markers: tuple[Marker, ...]
    inverted: bool = False
    by_id: dict[int, Marker] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "markers", tuple(self.markers))
        if not self.markers:
            raise ValueError("expected at least one marker, found none")
        count = len(load_dictionary(self.dictionary).bytesList)
        by_id: dict[int, Marker] = {}
        for marker in self.markers:
            if marker.id in by_id:
                raise ValueError(f"expected each id once, found id {marker.id} twice")
            if not 0 <= marker.id < count:
                raise ValueError(
                    f"expected ids of {self.dictionary} (0 to {count - 1}), found {marker.id}"
                )
            by_id[marker.id] = marker
        object.__setattr__(self, "by_id", by_id)

    @cached_property
    def ids(self) -> tuple[int, ...]:
        return tuple(sorted(self.by_id))

    def corners_m(self, ids: Iterable[int]) -> Array:
        """(4 N, 3) corners of the markers `ids`, in their order."""
        return np.concatenate([self.by_id[i].corners_m for i in ids])


def marker_rotation(yaw_rad: float, facing: Facing) -> Array:
    """R_map_marker (3, 3) of a marker that lies flat.

    Facing up it is Rz(yaw); facing down its columns are (c, s, 0), (s, -c, 0), (0, 0, -1).
    """
    if facing not in ("up", "down"):
        raise ValueError(f"expected facing up or down, found {facing!r}")
    rotation = rotation_z(yaw_rad)
    return rotation if facing == "up" else rotation @ np.diag([1.0, -1.0, -1.0])


def dictionary_names() -> list[str]:
    """Every dictionary name that this OpenCV knows."""
    return sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))


def load_dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of that name.

    Raises:
        ValueError: OpenCV has none of that name.
    """
    if name not in dictionary_names():
        raise ValueError(
            f"expected a dictionary of cv2.aruco such as DICT_6X6_1000, found {name!r}"
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
