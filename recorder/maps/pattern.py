"""Markers that break a pattern which nearly all others keep: a common yaw, a regular grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.geometry import wrap_angle
from pipeline.markers import Marker
from recorder.maps.findings import Finding
from recorder.maps.grid import grid_findings
from recorder.maps.plausibility import SAME_WAY_COS, direction_groups, direction_text
from recorder.maps.units import in_radians

_FEWEST = 8
_MOST_TURNED = 2
_TURNED_DEG = 5.0
# Five robust standard deviations.
_ODD = 5 * 1.4826


def pattern_findings(markers: Sequence[Marker]) -> list[Finding]:
    """Of eight markers or more that face the same way."""
    found = []
    for group in direction_groups(markers) if len(markers) >= _FEWEST else []:
        members = [markers[i] for i in group]
        if len(members) >= _FEWEST:
            found += _turned(members)
            if abs(float(np.median([marker.normal[2] for marker in members]))) > SAME_WAY_COS:
                found += grid_findings(members)
    return found


def _turned(members: Sequence[Marker]) -> list[Finding]:
    """One or two among markers that are all turned alike about the way that they face."""
    rights = np.array([marker.T_map_marker.rotation[:, 0] for marker in members])
    x, y, _ = (rights @ members[0].T_map_marker.rotation).T
    angles = np.arctan2(y, x)
    near = np.abs(wrap_angle(angles[:, None] - angles)) < np.radians(_TURNED_DEG)
    usual = int(near.sum(axis=1).argmax())
    alike = near[usual]
    if alike.sum() < len(members) - _MOST_TURNED:
        return []
    off_deg = np.degrees(wrap_angle(angles - angles[usual]))
    off_deg = off_deg - float(np.median(off_deg[alike]))
    limit = max(_TURNED_DEG, _ODD * float(np.median(np.abs(off_deg[alike]))))
    found = []
    for marker, off in zip(members, off_deg, strict=True):
        if abs(off) > limit and not in_radians(marker):
            text = (
                f"marker {marker.id} is turned by {abs(off):.0f} deg against the "
                f"{int(alike.sum())} others that face {direction_text(marker.normal)}"
            )
            found.append(Finding("warning", "turn", (marker.id,), text))
    return found
