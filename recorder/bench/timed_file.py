"""Marked waypoints as a truth.yaml that needs no marks."""

from __future__ import annotations

import math

from recorder.files.truth_entries import PathEntry, PoseEntry, TruthFile
from recorder.files.truth_file import StoodPose, Truth


def timed_truth(truth: Truth) -> TruthFile:
    """A truth without waypoints, whose poses have the times that `with_marks` gave them."""
    path = None
    if truth.path is not None:
        points_m = truth.path.points_m.tolist()
        path = PathEntry(points_m=points_m, closed=truth.path.closed, std_m=truth.path.std_m)
    return TruthFile(
        frame=truth.frame or "map",
        method=truth.method,
        path=path,
        poses=[_entry(pose) for pose in truth.poses],
    )


def _entry(pose: StoodPose) -> PoseEntry:
    return PoseEntry(
        name=pose.name,
        from_s=pose.from_s,
        to_s=pose.to_s,
        # Rounded, so that 45 does not become 45.00000000000001.
        x_m=round(pose.x_m, 9),
        y_m=round(pose.y_m, 9),
        z_m=pose.z_m,
        yaw_deg=None if pose.yaw_rad is None else round(math.degrees(pose.yaw_rad), 9),
        std_m=pose.std_m,
    )
