"""What a survey takes from a log: frames that see two mapped markers, with a pose to start from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from tqdm import tqdm

from pipeline.camera import Camera
from pipeline.detection import ArucoDetection, Detections
from pipeline.geometry import Pose
from pipeline.markers import MarkerMap
from pipeline.pose import RansacIterative
from pipeline.selection import usable
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent, LogImage
from replay.stages import PairedImage, cores, detect_ahead, opencv_threads

# Markers that are a few centimetres off fit worse than the default allows; here only poses to start
# from are wanted.
_START_REPROJECTION_PX = 20.0


@dataclass(frozen=True, eq=False)
class Sighting:
    """One frame's known markers, each seen once, and about where the camera was.

    Attributes:
        log: which of the logs it is from, from 0.
    """

    log: int
    frame_index: int
    detections: Detections
    T_map_camera: Pose


@dataclass(frozen=True)
class Span:
    """Which images of each log are looked at: every `every`-th from `from_s` to `to_s` seconds.

    Attributes:
        jobs: threads for decoding and detection (None: one per core); the result is the same.
    """

    from_s: float | None = None
    to_s: float | None = None
    every: int = 1
    jobs: int | None = None
    progress: bool = True


@dataclass
class FrameCount:
    """What became of the frames; every frame is in one of the others than `read`.

    Attributes:
        read: looked at.
        undecodable: no image of the camera's size.
        few_markers: fewer than two mapped markers.
        only_fixed: no marker that may move.
        without_pose: no pose to start from.
        usable: all others.
    """

    read: int = 0
    undecodable: int = 0
    few_markers: int = 0
    only_fixed: int = 0
    without_pose: int = 0
    usable: int = 0


class Sighter:
    """Judges frames by what they say about the markers that may move, and counts them."""

    def __init__(
        self, camera: Camera, marker_map: MarkerMap, fixed: Iterable[int], pose: RansacIterative
    ) -> None:
        self.count = FrameCount()
        self._camera = camera
        self._map = marker_map
        self._fixed = np.array(sorted(fixed), dtype=np.int64)
        gate = max(pose.max_reprojection_px, _START_REPROJECTION_PX)
        self._solver = pose.model_copy(update={"max_markers": None, "max_reprojection_px": gate})

    def __call__(self, log: int, frame_index: int, found: Detections | None) -> Sighting | None:
        """The frame, where it is of use; None for `found` is an image that was not decoded."""
        count = self.count
        count.read += 1
        if found is None:
            count.undecodable += 1
            return None
        known = usable(found, self._map).detections
        # A corner beyond the lens has no place in it.
        rays = self._camera.undistort(known.corners_px.reshape(-1, 2)).reshape(-1, 8)
        known = known.select(np.isfinite(rays).all(axis=1))
        if len(known) < 2:
            count.few_markers += 1
            return None
        if np.isin(known.ids, self._fixed).all():
            count.only_fixed += 1
            return None
        fix = self._solver(known, self._camera, self._map, 0.0)
        if fix.status not in ("ok", "reprojection") or fix.T_map_camera is None:
            count.without_pose += 1
            return None
        count.usable += 1
        return Sighting(log, frame_index, known, fix.T_map_camera)


def read_sightings(
    reader: LogReader,
    log: int,
    camera: Camera,
    marker_map: MarkerMap,
    detector: ArucoDetection,
    sighter: Sighter,
    span: Span,
) -> list[Sighting]:
    """The usable frames of a log."""
    jobs = span.jobs or cores()
    images = reader.image_count() if span.from_s is None and span.to_s is None else None
    sightings = []
    with (
        opencv_threads(1 if jobs > 1 else None),
        tqdm(
            total=None if images is None else -(-images // span.every),
            unit="frame",
            desc=reader.path.name,
            disable=None if span.progress else True,
        ) as bar,
    ):
        stream = _every(reader.records(span.from_s, span.to_s), span.every)
        for item in detect_ahead(stream, camera, lambda: detector.build(marker_map), jobs):
            if isinstance(item, LogEvent):
                continue
            bar.update()
            sighting = sighter(log, item.image.frame_index, item.detections)
            if sighting is not None:
                sightings.append(sighting)
    return sightings


def _every(records: Iterable[LogImage | ExactPose | LogEvent], every: int) -> Iterator[PairedImage]:
    """Each `every`-th image, from the first one."""
    images = (record for record in records if isinstance(record, LogImage))
    return (PairedImage(image, None) for image in islice(images, 0, None, every))
