"""Markers that are unlike the others: turned to the wrong side, tilted, off the plane, of odd size.

A map has no truth to be compared with; what most markers have in common is the measure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.geometry import Array
from pipeline.markers import Marker
from recorder.maps.findings import Finding

# Markers that face the same way to 20 degrees.
SAME_WAY_COS = float(np.cos(np.radians(20.0)))
# With fewer there is no saying who is the odd one.
FEWEST = 4
MIRRORED = (
    "a wrong facing, or corners not in the order top left, top right, bottom right, bottom left as "
    "one sees them"
)
# Ceilings are flat; walls and boards lean.
TILT_DEG = 1.0
_WALL_TILT_DEG = 3.0
_OFF_PLANE_M = 0.02
# Five robust standard deviations: rarer than once in a million.
_ODD = 5 * 1.4826
_SIZE_BOUNDS_M = (0.005, 3.0)
_SIZE_SHARE = 0.02
_UNEVEN_SHARE = 0.02
# Times the usual distance of neighbours: a row that is left out doubles it, a slip of the decimal
# point makes it ten times as long, less where it leads back towards the others.
_FAR = 4.0
_LEAST_FAR_M = 1.0
# Millimetres for metres: no camera is within sight of a marker all along such a way.
LOST_M = 100.0
_SITE_M = 1000.0
_COARSE_STD_M = 0.5


def plausibility_findings(markers: Sequence[Marker]) -> list[Finding]:
    """Everything that is odd about single markers, in the order of their checks."""
    if not markers:
        return []
    groups = direction_groups(markers)
    return [
        *_mirrored(markers, groups),
        *_facing_away(markers),
        *_tilted(markers, groups),
        *_off_plane(markers, groups),
        *_sizes(markers),
        *_uneven(markers),
        *_far_away(markers),
        *_uncertainties(markers),
    ]


def plausible_size(marker: Marker) -> bool:
    """Whether a printed marker can have such a side."""
    low, high = _SIZE_BOUNDS_M
    return low <= marker.size_m <= high


def direction_groups(markers: Sequence[Marker]) -> list[list[int]]:
    """Indices of the markers that face the same way to 20 degrees, the largest group first."""
    normals = np.array([marker.normal for marker in markers])
    near = normals @ normals.T > SAME_WAY_COS
    left = np.ones(len(markers), dtype=bool)
    groups = []
    while left.any():
        counts = (near & left).sum(axis=1) * left
        members = near[int(np.argmax(counts))] & left
        groups.append(np.flatnonzero(members).tolist())
        left &= ~members
    return groups


def direction_text(direction: Array) -> str:
    """`down`, `up`, or the way a wall's markers look, in degrees of map heading."""
    x, y, z = direction
    if abs(z) > np.cos(np.radians(45.0)):
        return "up" if z > 0 else "down"
    # Adding 0 turns -0 into 0.
    heading = round(float(np.degrees(np.arctan2(y, x)))) + 0
    return f"to {180 if heading == -180 else heading} deg"


def tilt_deg(marker: Marker) -> float:
    """How far a marker is from lying flat or hanging upright, whichever is nearer."""
    elevation = float(np.degrees(np.arcsin(np.clip(abs(marker.normal[2]), 0.0, 1.0))))
    return min(elevation, 90.0 - elevation)


def _mirrored(markers: Sequence[Marker], groups: list[list[int]]) -> list[Finding]:
    """Corners in the wrong order turn a marker's face into the surface that it is on."""
    found = []
    for larger in groups:
        normal = _middle_direction([markers[i] for i in larger])
        for smaller in groups:
            if len(smaller) >= len(larger) or len(larger) < FEWEST - 1:
                continue
            for i in smaller:
                marker = markers[i]
                opposite = marker.normal @ normal < -SAME_WAY_COS
                if opposite and _in_plane_of([markers[k] for k in larger], marker):
                    text = (
                        f"marker {marker.id} faces {direction_text(marker.normal)}, the "
                        f"{len(larger)} others in its plane {direction_text(normal)}: {MIRRORED}"
                    )
                    found.append(Finding("error", "mirrored", (marker.id,), text))
    return found


def _facing_away(markers: Sequence[Marker]) -> list[Finding]:
    """All of a map the wrong way round shows only in where the floor is."""
    up = np.array([marker.normal[2] for marker in markers])
    height_m = float(np.median([marker.centre_m[2] for marker in markers]))
    if height_m > 1.5 and (up > SAME_WAY_COS).all():
        side = f"up at a height of {height_m:.2f} m: only a camera above that sees them"
    elif height_m < 0.3 and (up < -SAME_WAY_COS).all():
        side = f"down at a height of {height_m:.2f} m: only a camera below the floor sees them"
    else:
        return []
    text = f"all markers face {side} (mirrored corners, a wrong facing, or a frame of its own)"
    return [Finding("warning", "facing", (), text)]


def _tilted(markers: Sequence[Marker], groups: list[list[int]]) -> list[Finding]:
    found = []
    largest = [markers[i] for i in groups[0]]
    for group in groups:
        members = [markers[i] for i in group]
        if len(members) < FEWEST:
            few = 10 * len(members) <= len(markers) or (
                len(members) < len(largest) >= FEWEST - 1
                and all(_in_plane_of(largest, marker) for marker in members)
            )
            if few and not _axis_parallel(members):
                names = ", ".join(str(m.id) for m in members)
                text = (
                    f"marker {names} faces a way of its own, tilted {tilt_deg(members[0]):.1f} deg"
                )
                found.append(Finding("warning", "tilt", tuple(m.id for m in members), text))
            continue
        normal = _middle_direction(members)
        angles = np.degrees([_angle(marker.normal, normal) for marker in members])
        # The angles of random tilts about two axes: their median is 1.18 sigma.
        flat = abs(normal[2]) > np.cos(np.radians(45.0))
        limit = max(TILT_DEG if flat else _WALL_TILT_DEG, 4.0 * float(np.median(angles)))
        for marker, angle in zip(members, angles, strict=True):
            if angle > limit:
                text = (
                    f"marker {marker.id} is tilted {angle:.1f} deg against the "
                    f"{len(members) - 1} others that face {direction_text(normal)}"
                )
                found.append(Finding("warning", "tilt", (marker.id,), text))
    return found


def _in_plane_of(members: Sequence[Marker], marker: Marker) -> bool:
    """Whether it is on the ceiling, floor or wall that they are on, whichever way it faces."""
    normal = _middle_direction(members)
    along = np.array([member.centre_m @ normal for member in members])
    band = max(0.05, 3.0 * float(np.abs(along - np.median(along)).max(initial=0.0)))
    return abs(float(marker.centre_m @ normal - np.median(along))) <= band


def _axis_parallel(members: Sequence[Marker]) -> bool:
    return all(tilt_deg(marker) < TILT_DEG for marker in members)


def _off_plane(markers: Sequence[Marker], groups: list[list[int]]) -> list[Finding]:
    """Of floors and ceilings; walls are often several behind each other."""
    found = []
    for group in groups:
        members = [markers[i] for i in group]
        normal = _middle_direction(members)
        if len(members) < FEWEST or abs(normal[2]) < np.cos(np.radians(45.0)):
            continue
        heights = np.array([marker.centre_m @ normal for marker in members]) * np.sign(normal[2])
        off = heights - np.median(heights)
        limit = max(_OFF_PLANE_M, _ODD * float(np.median(np.abs(off))))
        for marker, distance in zip(members, off, strict=True):
            if abs(distance) > limit:
                side = "above" if distance > 0 else "below"
                text = (
                    f"marker {marker.id} is {abs(distance):.3f} m {side} the plane of the "
                    f"{len(members) - 1} others that face {direction_text(normal)}"
                )
                found.append(Finding("warning", "height", (marker.id,), text))
    return found


def _sizes(markers: Sequence[Marker]) -> list[Finding]:
    found = []
    sizes = np.array([marker.size_m for marker in markers])
    low, high = _SIZE_BOUNDS_M
    implausible: dict[float, list[int]] = {}
    for marker in markers:
        if not plausible_size(marker):
            implausible.setdefault(marker.size_m, []).append(marker.id)
    for size_m, ids in implausible.items():
        who = f"marker {ids[0]} has" if len(ids) == 1 else f"{len(ids)} markers have"
        text = f"{who} a side of {size_m:g} m: expected {low:g} to {high:g} m; is that in metres?"
        found.append(Finding("error", "size", tuple(ids), text))
    median = float(np.median(sizes))
    spread = np.abs(sizes / median - 1.0)
    limit = max(_SIZE_SHARE, _ODD * float(np.median(spread)))
    if len(markers) >= FEWEST:
        for marker, share in zip(markers, spread, strict=True):
            if share > limit and plausible_size(marker):
                text = (
                    f"marker {marker.id} has a side of {marker.size_m:g} m, most have {median:g} m"
                )
                found.append(Finding("warning", "size", (marker.id,), text))
    return found


def _uneven(markers: Sequence[Marker]) -> list[Finding]:
    """Corners that a hand measured."""
    found = []
    for marker in markers:
        corners = marker.corners_m
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        diagonals = np.linalg.norm(corners[2:] - corners[:2], axis=1) / np.sqrt(2.0)
        uneven_m = float(np.abs(np.concatenate([sides, diagonals]) - marker.size_m).max())
        if uneven_m > _UNEVEN_SHARE * marker.size_m:
            text = (
                f"marker {marker.id} is no square by {1e3 * uneven_m:.1f} mm: sides of "
                f"{', '.join(f'{1e3 * side:.1f}' for side in sides)} mm"
            )
            found.append(Finding("warning", "square", (marker.id,), text))
    return found


def _far_away(markers: Sequence[Marker]) -> list[Finding]:
    """Single markers, by their nearest neighbours: groups far from each other are as sites are."""
    if len(markers) < 2:
        return []
    centres = np.array([marker.centre_m for marker in markers])
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(distances, np.inf)
    nearest = distances.min(axis=1)
    usual_m = float(np.median(nearest))
    lost = nearest > LOST_M
    # What a few that are lost stretch is told of them.
    common = centres if 2 * lost.sum() > len(markers) else centres[~lost]
    extent_m = float(np.ptp(common, axis=0).max())
    spread = f"the markers are spread over {extent_m:.0f} m, {usual_m:.2f} m from one to the next"
    if usual_m > LOST_M:
        text = f"{spread}: are the places in metres, not in millimetres?"
        return [Finding("error", "extent", (), text)]
    found = []
    if extent_m > _SITE_M:
        text = f"{spread}: are these places of one site, in metres?"
        found.append(Finding("warning", "extent", (), text))
    limit_m = max(_FAR * usual_m, _LEAST_FAR_M) if len(markers) >= FEWEST else np.inf
    for marker, distance, is_lost in zip(markers, nearest, lost, strict=True):
        if is_lost or distance > limit_m:
            text = f"marker {marker.id} is {distance:.2f} m from the nearest other; " + (
                "is that in metres?" if is_lost else f"half of them have one within {usual_m:.2f} m"
            )
            found.append(Finding("error" if is_lost else "warning", "far", (marker.id,), text))
    return found


def _uncertainties(markers: Sequence[Marker]) -> list[Finding]:
    found = []
    without = [marker.id for marker in markers if marker.std_m is None]
    if without and len(without) < len(markers):
        text = f"{len(without)} of {len(markers)} markers have no std_m"
        found.append(Finding("note", "std", tuple(without), text))
    for marker in markers:
        if marker.std_m is not None and marker.std_m > _COARSE_STD_M:
            text = f"marker {marker.id} has a std_m of {marker.std_m:g} m; is that in metres?"
            found.append(Finding("warning", "std", (marker.id,), text))
    return found


def _middle_direction(members: Sequence[Marker]) -> Array:
    """Robust: the median of each component, scaled to length 1."""
    middle: Array = np.median([marker.normal for marker in members], axis=0)
    return middle / np.linalg.norm(middle)


def _angle(a: Array, b: Array) -> float:
    """Exact for small angles, which arccos is not."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
