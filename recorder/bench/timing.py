"""Marks in a log and waypoints in truth.yaml together: timed poses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from recorder.bench.marks import Mark
from recorder.files.truth_file import StoodPose, Truth, Waypoint

# A key says that the camera is there now. It holds for the frames of this long, half of it before
# and half after; how far the camera moves meanwhile is not in the waypoint's std_m.
ARRIVAL_S = 0.2


@dataclass(frozen=True)
class TimedMarks:
    """What came of the marks.

    Attributes:
        poses: in the order of their times, none overlapping.
        problems: marks that could not be used, one line each.
    """

    poses: tuple[StoodPose, ...]
    problems: tuple[str, ...]


def timed_marks(truth: Truth, marks: Iterable[Mark]) -> TimedMarks:
    """The poses of the marked waypoints.

    Standing still gives a pose from its beginning to its end. An arrival gives one of `ARRIVAL_S`,
    cut where another pose begins or ends, and none while the camera stands still at the same place.
    Poses of the truth file that have a time of their own come first.
    """
    counted = [mark for mark in marks if not mark.undone]
    known = {waypoint.name: waypoint for waypoint in truth.waypoints}
    taken = list(truth.poses)
    poses: list[StoodPose] = []
    problems = _unknown(counted, known)
    for mark in sorted(counted, key=lambda mark: not mark.stood):
        waypoint = known.get(mark.name)
        if waypoint is None:
            continue
        if mark.to_s is None:
            problems.append(f"{mark.text()} was not ended: left out")
            continue
        if mark.to_s < 0 or (mark.stood and mark.to_s <= mark.from_s):
            problems.append(f"{mark.text()} lasts no time in the log: left out")
            continue
        span = _span(mark, taken)
        if span is None:
            continue
        if isinstance(span, str):
            problems.append(span)
            continue
        pose = _pose(waypoint, *span)
        taken.append(pose)
        poses.append(pose)
    return TimedMarks(tuple(sorted(poses, key=lambda pose: pose.from_s)), tuple(problems))


def with_marks(truth: Truth, marks: Iterable[Mark]) -> tuple[Truth, tuple[str, ...]]:
    """The truth with a timed pose for each mark; and what could not be used."""
    marks = tuple(marks)
    timed = timed_marks(truth, marks)
    poses = sorted((*truth.poses, *timed.poses), key=lambda pose: pose.from_s)
    problems = timed.problems
    if truth.waypoints and not marks:
        problems = ("the truth has waypoints, and the log no marks that say when they were",)
    return replace(truth, poses=tuple(poses)), problems


def _unknown(marks: list[Mark], known: dict[str, Waypoint]) -> list[str]:
    names = dict.fromkeys(mark.name for mark in marks if mark.name not in known)
    has = ", ".join(known) or "none"
    return [f"waypoint {name} is marked, and not in the truth, which has {has}" for name in names]


def _span(mark: Mark, taken: list[StoodPose]) -> tuple[float, float] | str | None:
    """From and to; None where it says nothing new; or why it cannot be used."""
    if mark.stood:
        from_s, to_s = max(mark.from_s, 0.0), mark.to_s or 0.0
        if any(pose.from_s < to_s and from_s < pose.to_s for pose in taken):
            return f"{mark.text()} overlaps another pose: left out"
        return from_s, to_s
    from_s, to_s = max(mark.from_s - ARRIVAL_S / 2, 0.0), mark.from_s + ARRIVAL_S / 2
    for pose in taken:
        if pose.from_s <= mark.from_s <= pose.to_s:
            if pose.name == mark.name:
                return None
            return f"{mark.text()} at {mark.from_s:.3f} s, while it was elsewhere: left out"
        if pose.to_s < mark.from_s:
            from_s = max(from_s, pose.to_s)
        else:
            to_s = min(to_s, pose.from_s)
    return from_s, to_s


def _pose(waypoint: Waypoint, from_s: float, to_s: float) -> StoodPose:
    return StoodPose(
        # To the millisecond, as the marks are: 12.3 + 0.1 is 12.400000000000002.
        round(from_s, 3),
        round(to_s, 3),
        waypoint.x_m,
        waypoint.y_m,
        waypoint.z_m,
        waypoint.yaw_rad,
        waypoint.std_m,
        waypoint.name,
    )
