"""What a check of a truth file has to say, and what it looks at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Array
from recorder.files.truth_file import Truth
from recorder.maps.findings import Severity


@dataclass(frozen=True)
class TruthFinding:
    """One thing about a truth file.

    Attributes:
        check: which check found it, one word such as `extent`.
        where: what it is about, such as `waypoint 3`; empty for the whole file.
        text: one line.
    """

    severity: Severity
    check: str
    where: str
    text: str


@dataclass(frozen=True)
class Place:
    """Where the truth says the camera was; None where it does not say.

    Attributes:
        label: `waypoint 3`, `pose at 12 s`.
    """

    label: str
    x_m: float
    y_m: float
    z_m: float | None
    yaw_rad: float | None
    std_m: float


def places(truth: Truth) -> list[Place]:
    """Of waypoints, and of poses that are none."""
    found = [
        Place(f"waypoint {w.name}", w.x_m, w.y_m, w.z_m, w.yaw_rad, w.std_m)
        for w in truth.waypoints
    ]
    names = {waypoint.name for waypoint in truth.waypoints}
    return found + [
        Place(f"pose at {p.from_s:g} s", p.x_m, p.y_m, p.z_m, p.yaw_rad, p.std_m)
        for p in truth.poses
        if p.name not in names
    ]


def positions(found: list[Place]) -> Array:
    """(N, 3); NaN where there is no height."""
    rows = [(p.x_m, p.y_m, np.nan if p.z_m is None else p.z_m) for p in found]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
