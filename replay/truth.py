"""Ground truth, laid over the frames of a log."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.geometry import Array, Pose, unit_quaternion, wrap_angle
from recorder.files.truth_file import Trajectory, Truth

TruthKind = Literal["exact", "measured"]

# A trajectory from another system says nothing about frames in a longer hole of it.
MAX_GAP_S = 1.0


@dataclass(frozen=True, eq=False)
class TruthRow:
    """The true pose at one frame; NaN where a value was not measured.

    Attributes:
        std_m: uncertainty of the position; 0 where exact, NaN where it is not known.
    """

    frame_index: int
    timestamp_ns: int
    kind: TruthKind
    position_m: tuple[float, float, float]
    quat_xyzw: tuple[float, float, float, float]
    yaw_rad: float
    std_m: float

    def pose_columns(self) -> tuple[float, ...]:
        """x_m, y_m, z_m, qx, qy, qz, qw, yaw_rad."""
        return (*self.position_m, *self.quat_xyzw, self.yaw_rad)


def exact_row(frame_index: int, timestamp_ns: int, T_map_camera: Pose) -> TruthRow:
    """The row for a pose that the source knew exactly."""
    x, y, z = T_map_camera.translation.tolist()
    qx, qy, qz, qw = T_map_camera.quat_xyzw.tolist()
    return TruthRow(
        frame_index, timestamp_ns, "exact", (x, y, z), (qx, qy, qz, qw), T_map_camera.yaw_rad, 0.0
    )


class MeasuredTruth:
    """What was measured of the frames' poses: stood-at poses and timed trajectories."""

    def __init__(self, truth: Truth | None, start_ns: int) -> None:
        """`start_ns`: capture stamp of the log's first image, where the spans count from."""
        self._start_ns = start_ns
        self._poses = truth.poses if truth else ()
        self._trajectory = truth.trajectory if truth else None
        self._position_of: dict[int, int] = {}
        if self._trajectory is not None and self._trajectory.frame_index is not None:
            indices = self._trajectory.frame_index.tolist()
            self._position_of = {frame: i for i, frame in enumerate(indices)}

    def at(self, frame_index: int, timestamp_ns: int) -> Iterator[TruthRow]:
        """The measured rows for one frame, none where nothing was measured.

        A stood-at pose holds from `from_s` to `to_s`, both included.
        """
        since_start_ns = timestamp_ns - self._start_ns
        for stood in self._poses:
            # In whole nanoseconds: 1.9 s is a frame's time, 19 * 1e8 * 1e-9 is above it.
            if round(stood.from_s * 1e9) <= since_start_ns <= round(stood.to_s * 1e9):
                nan = float("nan")
                yaw_rad = nan if stood.yaw_rad is None else stood.yaw_rad
                z_m = nan if stood.z_m is None else stood.z_m
                yield TruthRow(
                    frame_index,
                    timestamp_ns,
                    "measured",
                    (stood.x_m, stood.y_m, z_m),
                    (nan, nan, nan, nan),
                    yaw_rad,
                    stood.std_m,
                )
        sample = self._on_trajectory(frame_index, timestamp_ns)
        if sample is not None:
            x, y, z = sample.translation.tolist()
            qx, qy, qz, qw = sample.quat_xyzw.tolist()
            yield TruthRow(
                frame_index,
                timestamp_ns,
                "measured",
                (x, y, z),
                (qx, qy, qz, qw),
                sample.yaw_rad,
                float("nan"),
            )

    def _on_trajectory(self, frame_index: int, timestamp_ns: int) -> Sample | None:
        trajectory = self._trajectory
        if trajectory is None:
            return None
        if trajectory.frame_index is not None:
            i = self._position_of.get(frame_index)
            return None if i is None else _sample(trajectory, i)
        return interpolate(trajectory, timestamp_ns)


@dataclass(frozen=True, eq=False)
class Sample:
    """A pose of a trajectory; NaN where a value is not known.

    Attributes:
        translation: (3,).
        quat_xyzw: (4,).
    """

    translation: Array
    quat_xyzw: Array
    yaw_rad: float


def interpolate(trajectory: Trajectory, timestamp_ns: int) -> Sample | None:
    """The pose between the two samples around a time; None outside and in gaps over `MAX_GAP_S`."""
    stamps = trajectory.timestamp_ns
    if stamps is None:
        return None
    after = int(np.searchsorted(stamps, timestamp_ns))
    if after == len(stamps):
        return None
    if stamps[after] == timestamp_ns:
        return _sample(trajectory, after)
    before = after - 1
    if before < 0 or (stamps[after] - stamps[before]) * 1e-9 > MAX_GAP_S:
        return None
    share = float((timestamp_ns - stamps[before]) / (stamps[after] - stamps[before]))
    p, q = trajectory.positions_m, trajectory.quats_xyzw
    position = (1 - share) * p[before] + share * p[after]
    if not np.isfinite(q[[before, after]]).all():
        # The shorter way round.
        yaw_rad = trajectory.yaw_rad(before)
        turn_rad = float(wrap_angle(trajectory.yaw_rad(after) - yaw_rad))
        return Sample(position, np.full(4, np.nan), float(wrap_angle(yaw_rad + share * turn_rad)))
    a, b = unit_quaternion(q[before]), unit_quaternion(q[after])
    # The shorter way too; samples are close, so normalized interpolation is as good as slerp.
    b = -b if a @ b < 0 else b
    return _of_pose(Pose.from_quat(position, (1 - share) * a + share * b))


def _sample(trajectory: Trajectory, i: int) -> Sample:
    position, quat = trajectory.positions_m[i], trajectory.quats_xyzw[i]
    if np.isfinite(quat).all():
        return _of_pose(Pose.from_quat(position, quat))
    return Sample(position, quat, float(wrap_angle(trajectory.yaw_rad(i))))


def _of_pose(pose: Pose) -> Sample:
    return Sample(pose.translation, pose.quat_xyzw, pose.yaw_rad)
