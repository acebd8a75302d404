"""What a log shows to viewers that do not read its attachments."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.camera import Camera
from pipeline.geometry import Pose, rotation_z
from pipeline.markers import MarkerMap
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.files.truth_file import Truth, check_frame, parse_truth
from recorder.log import messages, topics

if TYPE_CHECKING:
    from collections.abc import Mapping

    from google.protobuf.message import Message

# A viewer draws every pose of a path; more than this tells nobody more.
_MAX_PATH_POSES = 2000


@dataclass(frozen=True, eq=False)
class Known:
    """What the attachments of a log say, parsed."""

    camera: Camera | None
    marker_map: MarkerMap | None
    truth: Truth | None

    @classmethod
    def parse(cls, attachments: Mapping[str, bytes], place: str = "") -> Known:
        """From the attachments' bytes; `place` goes before their names in messages.

        Raises:
            InputError: one of them is malformed, or truth and map are in different frames.
        """

        def where(name: str) -> Path:
            return Path(f"{place}{name}")

        camera = marker_map = truth = None
        if data := attachments.get(topics.CAMERA_FILE):
            camera = parse_camera(data, where(topics.CAMERA_FILE))
        if data := attachments.get(topics.MAP_FILE):
            marker_map = parse_map(data, where(topics.MAP_FILE))
        for name in topics.TRUTH_FILES:
            if data := attachments.get(name):
                truth = parse_truth(data, where(name))
                if marker_map is not None:
                    check_frame(truth, marker_map, where(name))
                break
        return cls(camera, marker_map, truth)

    @property
    def map_frame(self) -> str:
        if self.marker_map is not None:
            return self.marker_map.frame
        return self.truth.frame if self.truth and self.truth.frame else topics.MAP_FRAME


def static_messages(known: Known, timestamp_ns: int) -> Iterator[tuple[str, Message]]:
    """Topics and messages that hold for the whole log."""
    if known.camera is not None:
        yield topics.CALIBRATION, messages.to_calibration(timestamp_ns, known.camera)
    if known.marker_map is not None:
        yield topics.TRANSFORMS, messages.to_transforms(timestamp_ns, known.marker_map)
    path = _path(known.truth) if known.truth is not None else []
    if path:
        message = messages.to_poses_in_frame(timestamp_ns, known.map_frame, path)
        yield topics.TRUTH_PATH, message


def _path(truth: Truth) -> list[Pose]:
    if truth.path is not None:
        points = truth.path.points_m.tolist()
        if truth.path.closed:
            points.append(points[0])
        return [Pose(np.eye(3), np.array([x, y, 0.0])) for x, y in points]
    if truth.trajectory is not None:
        count = len(truth.trajectory)
        chosen = np.unique(np.linspace(0, count - 1, min(count, _MAX_PATH_POSES)).astype(int))
        return [truth.trajectory.pose_to_draw(i) for i in chosen.tolist()]
    return []


class DueTruth:
    """Hands out the measured poses as the log reaches their times."""

    def __init__(self, truth: Truth | None, start_ns: int | None = None) -> None:
        """`start_ns`: from which its seconds count; None: from the first frame."""
        self._start_ns = start_ns
        self._stood = sorted(truth.poses, key=lambda p: p.from_s) if truth else []
        self._trajectory = truth.trajectory if truth else None
        self._next_stood = 0
        self._next = 0

    def __call__(self, frame_index: int, timestamp_ns: int) -> Iterator[tuple[int, Pose]]:
        """Times and poses that are due at this frame, each once; those before the log never."""
        if self._start_ns is None:
            self._start_ns = timestamp_ns
        while self._next_stood < len(self._stood):
            stood = self._stood[self._next_stood]
            due_ns = self._start_ns + round(stood.from_s * 1e9)
            if due_ns > timestamp_ns:
                break
            self._next_stood += 1
            position = np.array([stood.x_m, stood.y_m, stood.z_m or 0.0])
            yield max(due_ns, self._start_ns), Pose(rotation_z(stood.yaw_rad or 0.0), position)
        trajectory = self._trajectory
        if trajectory is None:
            return
        stamps, now, first = trajectory.timestamp_ns, timestamp_ns, self._start_ns
        if stamps is None:
            stamps, now, first = trajectory.frame_index, frame_index, frame_index
        while stamps is not None and self._next < len(stamps) and stamps[self._next] <= now:
            i = self._next
            self._next += 1
            if stamps[i] >= first:
                due_ns = timestamp_ns if trajectory.timestamp_ns is None else int(stamps[i])
                yield due_ns, trajectory.pose_to_draw(i)
