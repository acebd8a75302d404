"""Rules on where the truth says the camera was: in sight of the map, at honest uncertainties."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

import numpy as np

from pipeline.geometry import Array
from pipeline.markers import MarkerMap
from recorder.bench.check.findings import TruthFinding, places, positions
from recorder.files.truth_entries import TruthFile
from recorder.files.truth_file import Truth
from recorder.info_text import counted

# A camera sees about as far to the side as it is away from the markers, and somewhat further.
_SIDE_OF_DISTANCE = 1.2
_LEAST_MARGIN_M = 1.0
_OTHER_UNIT = 10.0
_COARSE_STD_M = 0.5
_FINE_STD_M = 0.0005
_SQUARE_BOUNDS_M = (0.02, 2.0)
# Sides that no decimal says exactly.
_DENOMINATORS = (3, 6, 9, 12)
_SHARE_OF_STD = 0.2


def map_findings(truth: Truth, marker_map: MarkerMap) -> Iterator[TruthFinding]:
    """Within the map's extent, and on the side from which its markers are seen."""
    found = places(truth)
    yield from _extent(positions(found), [place.label for place in found], marker_map)
    yield from _side(positions(found), [place.label for place in found], marker_map)
    if truth.path is not None:
        corners = truth.path.points_m
        labels = [f"path.points_m[{i}]" for i in range(len(corners))]
        flat = np.column_stack([corners, np.full(len(corners), np.nan)])
        yield from _extent(flat, labels, marker_map)
    if truth.trajectory is not None:
        points = truth.trajectory.positions_m
        yield from _together(_extent(points, [""] * len(points), marker_map), len(points))
        yield from _together(_side(points, [""] * len(points), marker_map), len(points))


def std_findings(truth: Truth) -> Iterator[TruthFinding]:
    """Uncertainties that a hand can have."""
    stds = [(place.label, place.std_m) for place in places(truth)]
    if truth.path is not None:
        stds.append(("path", truth.path.std_m))
    for label, std_m in stds:
        if std_m > _COARSE_STD_M:
            text = f"{label} has a std_m of {std_m:g} m; is that in metres?"
            yield TruthFinding("warning", "std", label, text)
        elif std_m < _FINE_STD_M:
            text = f"{label} has a std_m of {std_m * 1e3:g} mm: no hand measures that well"
            yield TruthFinding("warning", "std", label, text)
    if truth.trajectory is not None:
        text = "a trajectory says nothing about its own uncertainty"
        yield TruthFinding("note", "std", "", text)


def same_place_findings(truth: Truth) -> Iterator[TruthFinding]:
    """Two waypoints at one place are one, or a slip."""
    for a, b in combinations(places(truth)[: len(truth.waypoints)], 2):
        if math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) <= a.std_m + b.std_m:
            text = f"{a.label} and {b.label} are at the same place"
            yield TruthFinding("warning", "twice", b.label, text)


def square_findings(file: TruthFile) -> Iterator[TruthFinding]:
    """The square's side is multiplied by every row and column: its rounding is too."""
    on_floor = [w for w in file.waypoints if w.row is not None and w.col is not None]
    if file.floor is None:
        return
    side = file.floor.square_m
    low, high = _SQUARE_BOUNDS_M
    if not low <= side <= high:
        text = f"squares of {side:g} m: expected {low:g} to {high:g} m; is that in metres?"
        yield TruthFinding("warning", "square", "floor", text)
    if not on_floor:
        yield TruthFinding("note", "square", "floor", "the floor has no waypoints on it")
        return
    meant = _meant(side)
    if meant is None:
        return
    squares = max(max(abs(w.row or 0.0), abs(w.col or 0.0)) for w in on_floor)
    off_m = abs(meant[0] / meant[1] - side) * squares
    if off_m > _SHARE_OF_STD * min(w.std_m for w in on_floor):
        text = (
            f"square_m {side!r} looks like {meant[0]}/{meant[1]} m, rounded: over {squares:g} "
            f"squares that is {off_m * 1e3:.1f} mm; write {meant[0] / meant[1]:.9f}"
        )
        yield TruthFinding("warning", "square", "floor", text)


def _meant(side: float) -> tuple[int, int] | None:
    """The fraction that a side of three digits or more is the rounding of."""
    digits = repr(side).partition(".")[2]
    if "e" in digits or len(digits.lstrip("0")) < 3:
        return None
    for q in _DENOMINATORS:
        p = round(side * q)
        off = abs(p / q - side)
        if math.gcd(p, q) == 1 and 1e-9 < off <= 0.5 * 10.0 ** -len(digits):
            return p, q
    return None


def _extent(points: Array, labels: list[str], marker_map: MarkerMap) -> Iterator[TruthFinding]:
    centres = np.array([marker.centre_m for marker in marker_map.markers])
    low, high = centres.min(axis=0), centres.max(axis=0)
    away_m = np.abs(points[:, 2:3] - centres[:, 2]).max(axis=1)
    # Without a height of its own a camera is somewhere between the floor and the markers.
    away_m = np.where(np.isnan(away_m), np.abs(centres[:, 2]).max(), away_m)
    margin_m = np.maximum(_SIDE_OF_DISTANCE * away_m, _LEAST_MARGIN_M)
    beyond = np.maximum(low[:2] - points[:, :2], points[:, :2] - high[:2]).max(axis=1)
    site_m = float((high - low)[:2].max()) + margin_m
    for label, over_m, limit_m, size_m in zip(labels, beyond, margin_m, site_m, strict=True):
        if over_m > limit_m:
            far = over_m > _OTHER_UNIT * size_m
            text = f"{label} is {over_m:.2f} m outside of the markers' extent" + (
                "; is that in metres?" if far else ", further than a camera sees"
            )
            yield TruthFinding("error" if far else "warning", "extent", label, text)


def _side(points: Array, labels: list[str], marker_map: MarkerMap) -> Iterator[TruthFinding]:
    """From behind, no marker is to be seen."""
    centres = np.array([marker.centre_m for marker in marker_map.markers])
    normals = np.array([marker.normal for marker in marker_map.markers])
    heights = f"{centres[:, 2].min():.2f} to {centres[:, 2].max():.2f} m"
    for label, point in zip(labels, points, strict=True):
        if np.isnan(point[2]):
            continue
        if not (((point - centres) * normals).sum(axis=1) > 0).any():
            text = (
                f"{label} is at a height of {point[2]:.2f} m, behind every marker "
                f"(they are at {heights})"
            )
            yield TruthFinding("error", "height", label, text)
        elif point[2] < -0.01 and centres[:, 2].min() >= 0:
            text = f"{label} is at a height of {point[2]:.2f} m: below the floor"
            yield TruthFinding("warning", "height", label, text)


def _together(findings: Iterator[TruthFinding], count: int) -> Iterator[TruthFinding]:
    """One for all poses of a trajectory."""
    found = list(findings)
    if found:
        worst = next((f for f in found if f.severity == "error"), found[0])
        text = f"{len(found)} of {counted(count, 'pose')}; the first{worst.text}"
        yield TruthFinding(worst.severity, worst.check, "trajectory", text)
