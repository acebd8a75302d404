"""Our values as Foxglove messages and back; every convention of theirs is dealt with here.

Times are nanoseconds since the Unix epoch and survive both ways exactly.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from pipeline.camera import Camera, DistortionModel
from pipeline.geometry import Pose
from pipeline.markers import MarkerMap
from recorder.log.topics import CAMERA_FRAME

_LEVELS = {
    "debug": Log.DEBUG,
    "info": Log.INFO,
    "warning": Log.WARNING,
    "error": Log.ERROR,
    "fatal": Log.FATAL,
}
_LEVEL_NAMES = {number: name for name, number in _LEVELS.items()}


def to_timestamp(timestamp_ns: int) -> Timestamp:
    seconds, nanos = divmod(timestamp_ns, 10**9)
    return Timestamp(seconds=seconds, nanos=nanos)


def from_timestamp(timestamp: Timestamp) -> int:
    return timestamp.seconds * 10**9 + timestamp.nanos


def to_image(timestamp_ns: int, data: bytes, format: str) -> CompressedImage:
    return CompressedImage(
        timestamp=to_timestamp(timestamp_ns), frame_id=CAMERA_FRAME, data=data, format=format
    )


def from_image(message: CompressedImage) -> tuple[int, bytes, str]:
    """Capture time, the compressed bytes and their format (`jpg`, as some say, is `jpeg`)."""
    format = "jpeg" if message.format in ("jpg", "") else message.format
    return from_timestamp(message.timestamp), message.data, format


def to_calibration(timestamp_ns: int, camera: Camera) -> CameraCalibration:
    k = camera.camera_matrix
    model: str = camera.distortion_model
    return CameraCalibration(
        timestamp=to_timestamp(timestamp_ns),
        frame_id=CAMERA_FRAME,
        width=camera.width_px,
        height=camera.height_px,
        distortion_model="kannala_brandt" if model == "equidistant" else model,
        D=camera.dist_coeffs.tolist(),
        K=k.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.hstack([k, np.zeros((3, 1))]).ravel().tolist(),
    )


def from_calibration(message: CameraCalibration) -> Camera:
    """The camera of a calibration message.

    Raises:
        ValueError: an unknown distortion model, or not a usable calibration.
    """
    model = message.distortion_model
    if model in ("kannala_brandt", "fisheye"):
        model = "equidistant"
    coefficients = list(message.D)
    if not model and not any(coefficients):
        model, coefficients = "plumb_bob", [0.0] * 5
    known: tuple[DistortionModel, ...] = get_args(DistortionModel)
    for name in known:
        if model == name:
            return Camera(
                message.width,
                message.height,
                np.array(message.K).reshape(3, 3),
                name,
                np.array(coefficients),
                message.frame_id or CAMERA_FRAME,
            )
    raise ValueError(f"expected a distortion model of {', '.join(known)}, found {model!r}")


def to_pose(pose: Pose) -> PoseMessage:
    return PoseMessage(position=_vector(pose), orientation=_quaternion(pose))


def from_pose(message: PoseMessage) -> Pose:
    """The pose of a message.

    Raises:
        ValueError: its quaternion has no length.
    """
    p, q = message.position, message.orientation
    return Pose.from_quat((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def to_pose_in_frame(timestamp_ns: int, frame: str, pose: Pose) -> PoseInFrame:
    return PoseInFrame(timestamp=to_timestamp(timestamp_ns), frame_id=frame, pose=to_pose(pose))


def from_pose_in_frame(message: PoseInFrame) -> tuple[int, str, Pose]:
    return from_timestamp(message.timestamp), message.frame_id, from_pose(message.pose)


def to_poses_in_frame(timestamp_ns: int, frame: str, poses: Iterable[Pose]) -> PosesInFrame:
    return PosesInFrame(
        timestamp=to_timestamp(timestamp_ns), frame_id=frame, poses=map(to_pose, poses)
    )


def to_transform(timestamp_ns: int, parent: str, child: str, pose: Pose) -> FrameTransform:
    """`pose` is T_parent_child."""
    return FrameTransform(
        timestamp=to_timestamp(timestamp_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=_vector(pose),
        rotation=_quaternion(pose),
    )


def to_transforms(timestamp_ns: int, marker_map: MarkerMap) -> FrameTransforms:
    """One frame `marker_ID` per marker."""
    return FrameTransforms(
        transforms=[
            to_transform(timestamp_ns, marker_map.frame, f"marker_{m.id}", m.T_map_marker)
            for m in marker_map.markers
        ]
    )


def to_event(timestamp_ns: int, level: str, message: str, name: str) -> Log:
    """An event; `level` is debug, info, warning, error or fatal.

    Raises:
        ValueError: another level.
    """
    if level not in _LEVELS:
        raise ValueError(f"expected a level of {', '.join(_LEVELS)}, found {level!r}")
    return Log(
        timestamp=to_timestamp(timestamp_ns), level=_LEVELS[level], message=message, name=name
    )


def from_event(message: Log) -> tuple[int, str, str, str]:
    """Time, level (`unknown` for one that is not ours), text and who said it."""
    level = _LEVEL_NAMES.get(message.level, "unknown")
    return from_timestamp(message.timestamp), level, message.message, message.name


def _vector(pose: Pose) -> Vector3:
    x, y, z = pose.translation.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(pose: Pose) -> Quaternion:
    x, y, z, w = pose.quat_xyzw.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
