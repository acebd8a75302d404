"""The flat things in a scene: markers on their paper, occluders, lamps."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array, Pose
from pipeline.markers import Marker, MarkerMap, load_dictionary

# Reflectance of office paper and laser toner.
PAPER = 0.85
INK = 0.05

_DISC_CELLS = 128
# A face is not seen from so near its own plane.
_EDGE_ON_M = 1e-6


@dataclass(frozen=True, eq=False)
class Quad:
    """A flat rectangle of cells with one reflectance each.

    Attributes:
        T_map_quad: frame at its centre: x right, y up, z out of the face.
        width_m, height_m: of the cells, without the margin.
        cells: (rows + 2, columns + 2) reflectance, top row first; the outer ring is the margin.
            Negative: a hole.
        margin: width of the margin, in cells.
        two_sided: seen from behind, too.
        layer: higher layers are drawn over lower ones; within a layer nearer over farther.
    """

    T_map_quad: Pose
    width_m: float
    height_m: float
    cells: npt.NDArray[np.float32]
    margin: float = 0.0
    two_sided: bool = False
    layer: int = 1

    def shows_face(self, T_camera_map: Pose) -> bool:
        T_camera_quad = T_camera_map @ self.T_map_quad
        distance = -float(T_camera_quad.rotation[:, 2] @ T_camera_quad.translation)
        return distance > _EDGE_ON_M or (self.two_sided and distance < -_EDGE_ON_M)

    def cell_frame(self, T_camera_map: Pose) -> Array:
        """(3, 3) from cell coordinates (s, t, 1) to the camera frame."""
        T_camera_quad = T_camera_map @ self.T_map_quad
        x, y, _ = T_camera_quad.rotation.T
        rows, columns = self.cells.shape[0] - 2, self.cells.shape[1] - 2
        top_left = T_camera_quad.translation - x * (self.width_m / 2) + y * (self.height_m / 2)
        return np.stack(
            [x * (self.width_m / columns), -y * (self.height_m / rows), top_left], axis=1
        )

    def outline(self) -> Array:
        """(4, 3) corners of the margin in cell coordinates (s, t, 1)."""
        rows, columns = self.cells.shape[0] - 2, self.cells.shape[1] - 2
        low, right, bottom = -self.margin, columns + self.margin, rows + self.margin
        return np.array(
            [[low, low, 1.0], [right, low, 1.0], [right, bottom, 1.0], [low, bottom, 1.0]]
        )


def marker_quads(
    marker_map: MarkerMap, quiet_zone_m: float | None = None, paper: float = PAPER, ink: float = INK
) -> tuple[Quad, ...]:
    """The printed markers of a map.

    A marker given by its corners is drawn as the exact square nearest to them.

    Args:
        quiet_zone_m: width of the paper around the black square; None: one cell of the marker.
    """
    dictionary = load_dictionary(marker_map.dictionary)
    side = dictionary.markerSize + 2
    quads = []
    for marker in marker_map.markers:
        bits = cv2.aruco.generateImageMarker(dictionary, marker.id, side) > 0
        printed = np.pad(bits, 1, constant_values=True) != marker_map.inverted
        quads.append(
            Quad(
                marker.T_map_marker,
                marker.size_m,
                marker.size_m,
                np.where(printed, paper, ink).astype(np.float32),
                margin=1.0 if quiet_zone_m is None else quiet_zone_m * side / marker.size_m,
            )
        )
    return tuple(quads)


def exact_squares(marker_map: MarkerMap) -> MarkerMap:
    """The map with each marker as the exact square that is drawn of it."""
    squares = tuple(
        Marker.from_pose(m.id, m.T_map_marker, m.size_m, m.std_m, m.tags)
        for m in marker_map.markers
    )
    return MarkerMap(marker_map.frame, marker_map.dictionary, squares, marker_map.inverted)


def rectangle(T_map_quad: Pose, width_m: float, height_m: float, reflectance: float) -> Quad:
    """An evenly grey rectangle that hides what is behind it."""
    cells = np.full((3, 3), reflectance, np.float32)
    return Quad(T_map_quad, width_m, height_m, cells, two_sided=True)


def disc(T_map_quad: Pose, radius_m: float, reflectance: float) -> Quad:
    """A round spot, below everything else."""
    at = (np.arange(_DISC_CELLS) + 0.5) / (_DISC_CELLS / 2) - 1.0
    inside = at[None, :] ** 2 + at[:, None] ** 2 < 1.0
    cells = np.where(np.pad(inside, 1), reflectance, -1.0).astype(np.float32)
    return Quad(T_map_quad, 2 * radius_m, 2 * radius_m, cells, two_sided=True, layer=0)
