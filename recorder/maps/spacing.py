"""Neighbours: how far markers are apart, which overlap, which leave too little white between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.geometry import Array
from pipeline.markers import Marker
from recorder.maps.findings import Finding

# Squares whose planes are less than this apart, and no more turned, are taken to be on one
# surface: hand-measured heights differ by centimetres.
_SAME_SURFACE_M = 0.05
_SAME_SURFACE_COS = float(np.cos(np.radians(20.0)))
# Squares that only touch do not overlap.
_TOUCHING = 1e-3


@dataclass(frozen=True)
class Neighbour:
    """The nearest other marker.

    Attributes:
        distance_m: between the centres.
        gap_m: between the black squares; 0 where they touch or overlap.
    """

    id: int
    distance_m: float
    gap_m: float


def nearest_neighbours(markers: Sequence[Marker]) -> list[Neighbour | None]:
    """For each marker the one whose centre is nearest; None for a marker that is alone."""
    if len(markers) < 2:
        return [None] * len(markers)
    distances = _distances(markers)
    np.fill_diagonal(distances, np.inf)
    found: list[Neighbour | None] = []
    for marker, row in zip(markers, distances, strict=True):
        nearest = int(np.argmin(row))
        other = markers[nearest]
        found.append(Neighbour(other.id, float(row[nearest]), square_gap_m(marker, other)))
    return found


def spacing_findings(markers: Sequence[Marker], modules: int | None) -> list[Finding]:
    """Pairs that overlap, and pairs without room for a quiet zone.

    Args:
        modules: side of the printed square in cells of the dictionary; None where it is unknown.
    """
    found = []
    distances = _distances(markers)
    sizes = np.array([marker.size_m for marker in markers])
    # A pair further apart than its half diagonals and a quiet zone has nothing to tell.
    reach = np.sqrt(2.0) / 2.0 * (sizes[:, None] + sizes) + sizes.max(initial=0.0)
    for i, j in np.argwhere(np.triu(distances < reach + _SAME_SURFACE_M, 1)):
        a, b = markers[i], markers[j]
        if overlap(a, b):
            text = f"{_pair(a, b)} overlap: their centres are {distances[i, j]:.3f} m apart"
            found.append(Finding("error", "overlap", (a.id, b.id), text))
            continue
        if modules is None:
            continue
        module_m = max(a.size_m, b.size_m) / modules
        gap_m = square_gap_m(a, b)
        if gap_m < (1.0 - _TOUCHING) * module_m and a.normal @ b.normal > 0:
            text = (
                f"{_pair(a, b)} leave {1e3 * gap_m:.1f} mm between their squares: a quiet zone "
                f"is one module, {1e3 * module_m:.1f} mm"
            )
            found.append(Finding("warning", "quiet_zone", (a.id, b.id), text))
    return found


def overlap(a: Marker, b: Marker) -> bool:
    """Whether two squares cover common ground on one surface, or cut through each other."""
    flat = _on_surface_of(a, b)
    if flat is not None:
        return _common_m2(a, flat) > _TOUCHING * min(a.size_m, b.size_m) ** 2
    return _cut_m(a, b) > _TOUCHING * min(a.size_m, b.size_m)


def square_gap_m(a: Marker, b: Marker) -> float:
    """Between two squares; along their surface where they are on one."""
    flat = _on_surface_of(a, b)
    if flat is None:
        if _cut_m(a, b) > 0:
            return 0.0
        return min(_corners_to_square_m(a, b), _corners_to_square_m(b, a))
    if _common_m2(a, flat) > 0:
        return 0.0
    first = _flat_square(a)
    return min(_corners_to_edges_m(first, flat), _corners_to_edges_m(flat, first))


def _distances(markers: Sequence[Marker]) -> Array:
    centres = np.array([marker.centre_m for marker in markers]).reshape(-1, 3)
    distances: Array = np.linalg.norm(centres[:, None] - centres, axis=2)
    return distances


def _pair(a: Marker, b: Marker) -> str:
    return f"markers {a.id} and {b.id}"


def _corners_in(a: Marker, b: Marker) -> Array:
    """(4, 3) corners of b in a's frame."""
    return a.T_map_marker.inverse().apply(b.corners_m)


def _flat_square(marker: Marker) -> Array:
    """(4, 2) its corners in its own plane."""
    return np.ascontiguousarray(_corners_in(marker, marker)[:, :2], dtype=np.float32)


def _on_surface_of(a: Marker, b: Marker) -> Array | None:
    """(4, 2) corners of b in a's plane; None where b is on another surface."""
    inside = _corners_in(a, b)
    tolerance = max(_SAME_SURFACE_M, 0.25 * min(a.size_m, b.size_m))
    if abs(a.normal @ b.normal) < _SAME_SURFACE_COS or np.abs(inside[:, 2]).mean() > tolerance:
        return None
    return np.ascontiguousarray(inside[:, :2], dtype=np.float32)


def _common_m2(a: Marker, flat: Array) -> float:
    area, _ = cv2.intersectConvexConvex(_flat_square(a), flat)
    return float(area)


def _cut_m(a: Marker, b: Marker) -> float:
    """Length of the cut of b's square through a's; 0 where there is none."""
    start = _corners_in(a, b)
    end = np.roll(start, -1, axis=0)
    ends = [
        p[:2] + (q[:2] - p[:2]) * (p[2] / (p[2] - q[2]))
        for p, q in zip(start, end, strict=True)
        if (p[2] < 0) != (q[2] < 0)
    ]
    if len(ends) != 2:
        return 0.0
    # What of the segment is inside: Liang & Barsky 1984.
    half, along = a.size_m / 2.0, ends[1] - ends[0]
    enter, leave = 0.0, 1.0
    for at, step in zip(ends[0], along, strict=True):
        if abs(step) < 1e-12:
            if abs(at) > half:
                return 0.0
            continue
        first, second = sorted(((-half - at) / step, (half - at) / step))
        enter, leave = max(enter, first), min(leave, second)
    return max(0.0, leave - enter) * float(np.linalg.norm(along))


def _corners_to_square_m(a: Marker, b: Marker) -> float:
    """From the corners of b to the nearest point of the square of a."""
    corners = _corners_in(a, b)
    half = a.size_m / 2.0
    nearest = np.column_stack([np.clip(corners[:, :2], -half, half), np.zeros(4)])
    return float(np.linalg.norm(corners - nearest, axis=1).min())


def _corners_to_edges_m(points: Array, polygon: Array) -> float:
    start = polygon.astype(np.float64)
    along = np.roll(start, -1, axis=0) - start
    to_points = points[:, None].astype(np.float64) - start
    share = np.clip((to_points * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(to_points - share[..., None] * along, axis=2).min())
