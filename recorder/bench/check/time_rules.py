"""Rules on when: spans in order, speeds that a robot can have, marks that fit the waypoints."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.geometry import Array
from recorder.bench.check.findings import TruthFinding
from recorder.bench.marks import Mark, log_marks
from recorder.files.trajectory_file import Trajectory
from recorder.files.truth_entries import TruthFile
from recorder.files.truth_file import Truth
from recorder.log import topics
from recorder.log.reader import LogReader

_FAST_MPS = 3.0
# Between two stamps of a timed trajectory; motion capture jumps when it confuses its targets.
_JUMP_MPS = 5.0
_SHORT_S = 1.0
# Spans are told to the millisecond.
_STAMP_S = 0.0005


@dataclass(frozen=True, eq=False)
class LogTimes:
    """What a log says about times.

    Attributes:
        frames_s: (N,) when images were captured, from the first one's capture, in order.
        start_ns: capture stamp of second 0; None where it is not known.
        numbers: the first and the last frame's; None where they are not known.
    """

    frames_s: Array
    marks: tuple[Mark, ...]
    start_ns: int | None = None
    numbers: tuple[int, int] | None = None

    @property
    def duration_s(self) -> float:
        """From the first image's capture to the last one's."""
        return float(self.frames_s[-1]) if len(self.frames_s) else 0.0


def log_times(log: LogReader) -> LogTimes:
    """What a log says about times; reads all of it."""
    images = [
        (message.publish_time, message.sequence)
        for _, channel, message in log.messages()
        if channel.topic == topics.IMAGE
    ]
    start_ns = log.start_ns or 0
    # Whole nanoseconds since 1970 are more than a float can tell apart.
    since_ns = np.array(sorted(time_ns for time_ns, _ in images), dtype=np.int64) - start_ns
    last = max((number for _, number in images), default=0)
    # A log of another make may leave them at 0.
    numbers = (min(number for _, number in images), last) if last else None
    return LogTimes(np.asarray(since_ns / 1e9), log_marks(log), start_ns, numbers)


def order_findings(file: TruthFile) -> Iterator[TruthFinding]:
    """Spans as they stand in the file."""
    for i, (before, after) in enumerate(pairwise(file.poses), 1):
        if after.from_s < before.from_s:
            text = f"poses[{i}] begins at {after.from_s:g} s, before the one above it"
            yield TruthFinding("warning", "order", f"poses[{i}]", text)


def speed_findings(truth: Truth) -> Iterator[TruthFinding]:
    """How fast the camera must have been between two places."""
    for a, b in pairwise(truth.poses):
        way_m = math.hypot(b.x_m - a.x_m, b.y_m - a.y_m)
        between_s = b.from_s - a.to_s
        if way_m <= 3 * (a.std_m + b.std_m):
            continue
        where = f"pose at {b.from_s:g} s"
        way = f"{way_m:.2f} m from {a.to_s:g} s to {b.from_s:g} s"
        if between_s < 1e-3:
            text = f"{way}: at two places at the same time"
            yield TruthFinding("error", "speed", where, text)
        elif way_m / between_s > _FAST_MPS:
            text = f"{way}: {way_m / between_s:.1f} m/s"
            yield TruthFinding("warning", "speed", where, text)
    trajectory = truth.trajectory
    if trajectory is None:
        return
    if trajectory.unsorted_at is not None:
        text = f"the poses are not in order from {trajectory.unsorted_at} on; they are sorted"
        yield TruthFinding("warning", "order", "trajectory", text)
    if trajectory.timestamp_ns is not None and len(trajectory) > 1:
        ways_m = np.linalg.norm(np.diff(trajectory.positions_m[:, :2], axis=0), axis=1)
        speeds = ways_m / (np.diff(trajectory.timestamp_ns) / 1e9)
        fast = np.flatnonzero(speeds > _JUMP_MPS)
        if len(fast):
            text = (
                f"{len(fast)} of {len(speeds)} steps are faster than {_JUMP_MPS:g} m/s, the first "
                f"with {speeds[fast[0]]:.1f} m/s at {trajectory.timestamp_ns[fast[0]] / 1e9:.3f} s"
            )
            yield TruthFinding("warning", "speed", "trajectory", text)


def frame_findings(truth: Truth, frames_s: Array) -> Iterator[TruthFinding]:
    """Poses within the log that no image was taken at: the camera was off, or too slow."""
    if not len(frames_s):
        return
    for pose in truth.poses:
        first, after = np.searchsorted(frames_s, (pose.from_s - _STAMP_S, pose.to_s + _STAMP_S))
        if first == after and pose.to_s <= frames_s[-1]:
            name = f" of waypoint {pose.name}" if pose.name else ""
            nearest_s = float(np.abs(frames_s - (pose.from_s + pose.to_s) / 2).min())
            text = (
                f"no image from {pose.from_s:g} s to {pose.to_s:g} s, the nearest is "
                f"{nearest_s:.2f} s away: the pose{name} is compared with none"
            )
            yield TruthFinding("warning", "log", f"pose at {pose.from_s:g} s", text)


def log_findings(truth: Truth, log: LogTimes) -> Iterator[TruthFinding]:
    """Whether the truth speaks of this log, and its marks of these waypoints."""
    for pose in truth.poses:
        if pose.to_s > log.duration_s + 1e-3:
            after = pose.from_s > log.duration_s
            text = (
                f"the pose from {pose.from_s:g} s to {pose.to_s:g} s "
                f"{'is' if after else 'ends'} after the log, which ends at {log.duration_s:.3f} s"
            )
            yield TruthFinding(
                "error" if after else "warning", "log", f"pose at {pose.from_s:g} s", text
            )
    yield from frame_findings(truth, log.frames_s)
    if _is_of_another_time(truth.trajectory, log):
        text = "the trajectory is of another time than the log"
        yield TruthFinding("error", "log", "trajectory", text)
    counted = [mark for mark in log.marks if not mark.undone]
    marked = {mark.name for mark in counted}
    if counted and not truth.waypoints:
        text = f"the log has {len(counted)} marks, and the truth no waypoints for them"
        yield TruthFinding("note", "marks", "", text)
    for waypoint in truth.waypoints:
        if counted and waypoint.name not in marked:
            text = f"waypoint {waypoint.name} is never marked in the log"
            yield TruthFinding("note", "marks", f"waypoint {waypoint.name}", text)
    for mark in counted:
        lasts_s = None if mark.to_s is None else mark.to_s - mark.from_s
        if mark.stood and lasts_s is not None and lasts_s < _SHORT_S:
            text = f"{mark.text()} lasts {lasts_s:.1f} s only: s pressed twice?"
            yield TruthFinding("warning", "marks", f"waypoint {mark.name}", text)


def _is_of_another_time(trajectory: Trajectory | None, log: LogTimes) -> bool:
    """No pose of it is between the first and the last image."""
    if trajectory is None or not len(trajectory) or not len(log.frames_s):
        return False
    if trajectory.timestamp_ns is not None and log.start_ns is not None:
        begin_s, end_s = (trajectory.timestamp_ns[[0, -1]] - log.start_ns) / 1e9
        return bool(end_s < -_STAMP_S or begin_s > log.duration_s + _STAMP_S)
    if trajectory.frame_index is not None and log.numbers is not None:
        first, last = log.numbers
        return bool(trajectory.frame_index[-1] < first or trajectory.frame_index[0] > last)
    return False
