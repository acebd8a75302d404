"""All of a map in a wrong unit: angles in radians, lengths in millimetres or centimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.markers import Marker
from recorder.maps.findings import Finding
from recorder.maps.plausibility import FEWEST, LOST_M, SAME_WAY_COS, plausible_size
from recorder.maps.spacing import nearest_neighbours
from recorder.radians import looks_like_radians

_HEIGHTS_M = (-5.0, 50.0)
# Sides from one marker to the next: a camera that reads a marker of 20 pixels has both in a
# picture that is 3000 wide.
_MOST_SIDES = 150.0


def unit_findings(markers: Sequence[Marker]) -> list[Finding]:
    """What is odd about all of a map, each slip told once."""
    return [*_radians(markers), *(_lengths(markers) if markers else [])]


def in_radians(marker: Marker) -> bool:
    """Whether its yaw looks like it; of markers exactly flat, as those with a yaw_deg are."""
    flat = abs(abs(float(marker.normal[2])) - 1.0) < 1e-12
    return flat and looks_like_radians(_yaw_deg(marker))


def _yaw_deg(marker: Marker) -> float:
    return float(np.degrees(marker.T_map_marker.yaw_rad))


def _radians(markers: Sequence[Marker]) -> list[Finding]:
    turned = [marker for marker in markers if in_radians(marker)]
    if not turned:
        return []
    angles = ", ".join(f"{yaw:g}" for yaw in sorted({round(_yaw_deg(m), 4) for m in turned}))
    who = f"marker {turned[0].id} has" if len(turned) == 1 else f"{len(turned)} markers have"
    text = f"{who} a yaw of {angles} degrees, which looks like radians"
    return [Finding("warning", "yaw", tuple(marker.id for marker in turned), text)]


def _lengths(markers: Sequence[Marker]) -> list[Finding]:
    apart_m = [near.distance_m for near in nearest_neighbours(markers) if near is not None]
    usual_m = float(np.median(apart_m)) if apart_m else 0.0
    side_m = float(np.median([marker.size_m for marker in markers]))
    if usual_m > LOST_M:
        # Told as an error by `plausibility`.
        return []
    sized = len(markers) >= FEWEST and all(plausible_size(marker) for marker in markers)
    if sized and usual_m > _MOST_SIDES * side_m:
        text = (
            f"half of the markers are {usual_m:.2f} m or more from the nearest other, "
            f"{usual_m / side_m:.0f} times their side of {side_m:g} m: no camera sees two at once; "
            "are the places in metres?"
        )
        return [Finding("warning", "extent", (), text)]
    flat = np.array([abs(float(marker.normal[2])) > SAME_WAY_COS for marker in markers])
    height_m = float(np.median([marker.centre_m[2] for marker in markers]))
    low, high = _HEIGHTS_M
    if 2 * flat.sum() > len(markers) and not low <= height_m <= high:
        text = f"most markers are at a height of {height_m:g} m: is z in metres?"
        return [Finding("warning", "heights", (), text)]
    return []
