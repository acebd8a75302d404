"""Maps of two or three markers, where no majority says which is the odd one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.markers import Marker
from recorder.maps.findings import Finding
from recorder.maps.plausibility import (
    FEWEST,
    MIRRORED,
    SAME_WAY_COS,
    TILT_DEG,
    direction_text,
    tilt_deg,
)

# Nobody hangs a marker this well: it was written as level.
_LEVEL_DEG = 0.1
_SAME_PLANE_M = 0.05


def few_findings(markers: Sequence[Marker]) -> list[Finding]:
    """That little is compared, and what shows all the same."""
    if not 2 <= len(markers) < FEWEST:
        return []
    text = (
        f"with fewer than {FEWEST} markers there is no telling which is the odd one: their places, "
        "yaws and sides are not compared"
    )
    return [*_opposite(markers), *_tilted(markers), Finding("note", "few", (), text)]


def _opposite(markers: Sequence[Marker]) -> list[Finding]:
    first = markers[0]
    away = [m for m in markers if m.normal @ first.normal < -SAME_WAY_COS]
    same = [m for m in markers if m.normal @ first.normal > SAME_WAY_COS]
    along = [float(marker.centre_m @ first.normal) for marker in markers]
    if not away or len(away) + len(same) < len(markers) or float(np.ptp(along)) > _SAME_PLANE_M:
        return []
    sides = "; ".join(
        f"{', '.join(str(marker.id) for marker in side)} {direction_text(side[0].normal)}"
        for side in (same, away)
    )
    text = f"markers of one plane face opposite ways ({sides}): {MIRRORED}"
    odd = min((away, same), key=len) if len(away) != len(same) else [*same, *away]
    return [Finding("warning", "mirrored", tuple(m.id for m in odd), text)]


def _tilted(markers: Sequence[Marker]) -> list[Finding]:
    tilted = [marker for marker in markers if tilt_deg(marker) > _LEVEL_DEG]
    if len(tilted) != 1 or tilt_deg(tilted[0]) <= TILT_DEG:
        return []
    odd = tilted[0]
    others = "the other is" if len(markers) == 2 else "the others are"
    text = f"marker {odd.id} is tilted {tilt_deg(odd):.1f} deg, {others} level or upright"
    return [Finding("warning", "tilt", (odd.id,), text)]
