"""The whole pipeline as one step per frame, the same for a live camera and for a replay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, field_validator

from pipeline.camera import Camera
from pipeline.detection import ArucoDetection, Detections, GrayImage
from pipeline.markers import MarkerMap
from pipeline.pose import PoseFix, RansacIterative
from pipeline.settings import Settings
from pipeline.tracker import ConstantVelocity, TrackState
from pipeline.variance import StaticVariance, TableVariance

PAPER_TRACKERS: dict[str, ConstantVelocity] = {
    "adaptive": ConstantVelocity(variance=TableVariance()),
    "min": ConstantVelocity(variance=StaticVariance(statistic="min")),
    "max": ConstantVelocity(variance=StaticVariance(statistic="max")),
    "mean": ConstantVelocity(variance=StaticVariance(statistic="mean")),
    "median": ConstantVelocity(variance=StaticVariance(statistic="median")),
}


class PipelineSettings(Settings):
    """Everything that a replay can vary; the defaults are the paper's pipeline."""

    detector: ArucoDetection = ArucoDetection()
    pose: RansacIterative = RansacIterative()
    trackers: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")], ConstantVelocity] = Field(
        default=PAPER_TRACKERS, description="by name; without any, the paper's five models"
    )

    @field_validator("trackers")
    @classmethod
    def _not_empty(cls, trackers: dict[str, ConstantVelocity]) -> dict[str, ConstantVelocity]:
        if not trackers:
            raise ValueError("expected at least one tracker, found none")
        if "fixes" in trackers:
            raise ValueError("expected another name: `fixes` are the poses no filter has touched")
        return trackers


@dataclass(frozen=True, eq=False)
class Frame:
    """One captured image.

    Attributes:
        timestamp_ns: capture time.
        image: (H, W) gray, or None where the image could not be decoded.
    """

    frame_index: int
    timestamp_ns: int
    image: GrayImage | None


@dataclass(frozen=True, eq=False)
class FrameResult:
    """Everything the pipeline says about one frame."""

    frame_index: int
    timestamp_ns: int
    detections: Detections
    fix: PoseFix
    tracks: Mapping[str, TrackState]


class Localizer:
    """Detects, solves and tracks, one frame at a time, in the order of capture."""

    def __init__(
        self, settings: PipelineSettings, camera: Camera, marker_map: MarkerMap, start_ns: int
    ) -> None:
        """`start_ns`: the capture stamp of the log's first image, where its seconds count from."""
        self._camera = camera
        self._map = marker_map
        self._start_ns = start_ns
        self._solver = settings.pose
        self._detector = settings.detector.build(marker_map)
        self._trackers = {name: tracker.build() for name, tracker in settings.trackers.items()}

    def advance(
        self, frame_index: int, timestamp_ns: int, detections: Detections | None
    ) -> FrameResult:
        """Pose and tracks from a frame's detections; None for an image that was not decoded."""
        if detections is None:
            detections, fix = Detections.none(), PoseFix("undecodable")
        else:
            time_s = (timestamp_ns - self._start_ns) / 1e9
            fix = self._solver(detections, self._camera, self._map, time_s)
        tracks = {name: t.step(timestamp_ns, fix) for name, t in self._trackers.items()}
        return FrameResult(frame_index, timestamp_ns, detections, fix, tracks)

    def step(self, frame: Frame) -> FrameResult:
        """One frame's result; never an exception for what an image may show."""
        detections = None if frame.image is None else self._detector(frame.image)
        return self.advance(frame.frame_index, frame.timestamp_ns, detections)
