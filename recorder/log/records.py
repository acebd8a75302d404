"""What a log holds, as its reader gives it."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.geometry import Pose


@dataclass(frozen=True, eq=False)
class LogImage:
    """One image of a log.

    Attributes:
        frame_index: the source's frame number; a gap is a dropped frame.
        timestamp_ns: capture.
        data: compressed, exactly as the camera gave it.
        format: `jpeg`, `png` or `webp`.
    """

    frame_index: int
    timestamp_ns: int
    arrival_ns: int
    data: bytes
    format: str


@dataclass(frozen=True, eq=False)
class ExactPose:
    """The camera's exact pose at one frame."""

    frame_index: int
    timestamp_ns: int
    T_map_camera: Pose


@dataclass(frozen=True)
class LogEvent:
    """Something that happened; `level` is debug, info, warning, error, fatal or unknown."""

    timestamp_ns: int
    level: str
    message: str
    name: str


LogRecord = LogImage | ExactPose | LogEvent
