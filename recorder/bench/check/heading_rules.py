"""Rules on headings: degrees, and along the path as the others are."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pipeline.geometry import Array, wrap_angle
from recorder.bench.check.findings import Place, TruthFinding, places
from recorder.files.truth_entries import TruthFile
from recorder.files.truth_file import Truth, TruthPath
from recorder.radians import looks_like_radians

_OFF_DEG = 20.0
# Nearer to a corner than this, a heading may be that of either side.
_CORNER_M = 0.1
_FEWEST = 3


def unit_findings(file: TruthFile) -> Iterator[TruthFinding]:
    """Angles that are none in degrees."""
    headings = [(f"waypoint {w.name}", w.yaw_deg or w.heading_deg) for w in file.waypoints]
    headings += [(f"pose at {p.from_s:g} s", p.yaw_deg) for p in file.poses]
    for label, angle in headings:
        if not angle:
            continue
        if abs(angle) > 360:
            text = f"{label} has a heading of {angle:g} degrees: more than a turn"
            yield TruthFinding("warning", "heading", label, text)
        elif looks_like_radians(angle):
            text = f"{label} has a heading of {angle:g} degrees, which looks like radians"
            yield TruthFinding("warning", "heading", label, text)


def path_findings(truth: Truth) -> Iterator[TruthFinding]:
    """Places on the path, and how the camera is turned against the way it goes there.

    That turn is the mount's: it may be any, and is the same everywhere.
    """
    if truth.path is None:
        return
    on_path: list[tuple[Place, float]] = []
    off_path: list[tuple[Place, float]] = []
    for place in places(truth):
        distance_m, direction_rad = _nearest(truth.path, np.array([place.x_m, place.y_m]))
        if distance_m > 3 * (truth.path.std_m + place.std_m):
            off_path.append((place, distance_m))
        elif place.yaw_rad is not None and direction_rad is not None:
            on_path.append((place, float(wrap_angle(place.yaw_rad - direction_rad))))
    if off_path and len(off_path) < len(places(truth)) / 2:
        for place, distance_m in off_path:
            text = f"{place.label} is {distance_m:.2f} m off the path, the others are on it"
            yield TruthFinding("warning", "path", place.label, text)
    yield from _unlike_the_others(on_path)


def _unlike_the_others(turns: list[tuple[Place, float]]) -> Iterator[TruthFinding]:
    if len(turns) < _FEWEST:
        return
    angles = np.array([turn for _, turn in turns])
    near = np.abs(wrap_angle(angles[:, None] - angles)) < math.radians(_OFF_DEG)
    usual = int(near.sum(axis=1).argmax())
    if near[usual].sum() <= len(turns) / 2:
        return
    for (place, turn_rad), agrees in zip(turns, near[usual], strict=True):
        if not agrees:
            text = (
                f"{place.label} is turned by {math.degrees(turn_rad):.0f} degrees against the "
                f"path, most others by {math.degrees(angles[usual]):.0f}"
            )
            yield TruthFinding("warning", "heading", place.label, text)


def _nearest(path: TruthPath, point: Array) -> tuple[float, float | None]:
    """Distance to the path, and its direction there; None near a corner, where it has two."""
    starts, ends = path.points_m, np.roll(path.points_m, -1, axis=0)
    if not path.closed:
        starts, ends = starts[:-1], ends[:-1]
    best_m, direction = math.inf, None
    for start, end in zip(starts, ends, strict=True):
        side = end - start
        length2 = float(side @ side)
        share = min(max(float((point - start) @ side) / length2, 0.0), 1.0) if length2 else 0.0
        distance_m = float(np.linalg.norm(point - start - share * side))
        if distance_m < best_m:
            best_m, direction = distance_m, math.atan2(side[1], side[0])
    corners = np.linalg.norm(path.points_m - point, axis=1)
    return best_m, None if corners.min() < _CORNER_M else direction
