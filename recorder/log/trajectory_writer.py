"""Trajectories as a log of their own, for viewers that know Foxglove's schemas."""

from __future__ import annotations

import errno
import heapq
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.geometry import Pose
from recorder.log import messages, topics
from recorder.log.derived import Known, static_messages
from recorder.log.log_file import DiskFullError
from recorder.log.mcap_output import McapOutput

if TYPE_CHECKING:
    from google.protobuf.message import Message

METADATA = "trajectories"

# Markers are on /tf as FrameTransforms; a topic has one schema only.
CAMERA_TRANSFORM = f"{topics.TRANSFORMS}/camera"


@dataclass(frozen=True, eq=False)
class TimedPose:
    """T_map_camera at a capture time."""

    frame_index: int
    timestamp_ns: int
    T_map_camera: Pose


def write_trajectories(
    path: Path,
    by_topic: Mapping[str, Iterable[TimedPose]],
    *,
    camera_topic: str,
    attachments: Mapping[str, bytes],
    metadata: Mapping[str, str],
) -> None:
    """An MCAP file with a `PoseInFrame` topic per trajectory; replaces `path` when it is whole.

    What the attachments say (calibration, markers, measured path) is on the topics of a log.

    Args:
        by_topic: each in the order of its times.
        camera_topic: the trajectory that also moves the frame `camera`, as `FrameTransform`s from
            the map frame on `/tf/camera`.
        attachments: `camera.yaml`, `map.yaml`, `truth.*`, as far as they are known.

    Raises:
        InputError: an attachment is malformed.
        OSError: the file cannot be written; nothing is left of it.
    """
    known = Known.parse(attachments)
    # PATH.part may be what is left of a recording.
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    raw = open(partial, "wb", buffering=0)  # noqa: SIM115
    try:
        try:
            output = McapOutput(raw, path.parent)
        except BaseException:
            raw.close()
            raise
        try:
            for name, data in attachments.items():
                output.add_attachment(0, name, "application/octet-stream", data)
            _write(output, by_topic, camera_topic, known)
            output.finish(METADATA, metadata)
            if output.full:
                raise DiskFullError
        except DiskFullError as error:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        finally:
            output.close()
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _write(
    output: McapOutput,
    by_topic: Mapping[str, Iterable[TimedPose]],
    camera_topic: str,
    known: Known,
) -> None:
    streams = [_messages(topic, poses, known.map_frame) for topic, poses in by_topic.items()]
    begun = False
    for item, topic, message in heapq.merge(*streams, key=lambda m: m[0].timestamp_ns):
        stamps = (item.timestamp_ns, item.timestamp_ns)
        if not begun:
            begun = True
            for static_topic, static in static_messages(known, item.timestamp_ns):
                output.write(static_topic, static, *stamps)
        output.write(topic, message, *stamps, item.frame_index)
        if topic == camera_topic:
            transform = messages.to_transform(
                item.timestamp_ns, known.map_frame, topics.CAMERA_FRAME, item.T_map_camera
            )
            output.write(CAMERA_TRANSFORM, transform, *stamps, item.frame_index)


def _messages(
    topic: str, poses: Iterable[TimedPose], frame: str
) -> Iterator[tuple[TimedPose, str, Message]]:
    for item in poses:
        yield item, topic, messages.to_pose_in_frame(item.timestamp_ns, frame, item.T_map_camera)
