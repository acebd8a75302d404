"""A log's records on their way to the tracker: decoded and detected ahead, in the log's order."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.camera import Camera
from pipeline.detection import Detections, GrayImage
from recorder.log.reader import ExactPose, LogEvent, LogImage

# The sensor's own rows and columns, whatever an EXIF tag says: those were calibrated.
_GRAY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION

Detect = Callable[[GrayImage], Detections]


@dataclass(frozen=True, eq=False)
class PairedImage:
    """An image with its exact pose, where the log has one."""

    image: LogImage
    exact: ExactPose | None


@dataclass(frozen=True, eq=False)
class DetectedImage:
    """A paired image with its detections; None where it is no image of the camera's size."""

    image: LogImage
    exact: ExactPose | None
    detections: Detections | None


def pair(
    records: Iterable[LogImage | ExactPose | LogEvent],
) -> Iterator[PairedImage | LogEvent]:
    """Joins each image with the exact pose that the log has beside it, whichever comes first."""
    image: LogImage | None = None
    exact: ExactPose | None = None
    for record in records:
        if isinstance(record, LogEvent):
            yield record
        elif isinstance(record, ExactPose):
            exact = record
        else:
            if image is not None:
                yield PairedImage(image, None)
            image = record
        if image is not None and exact is not None and exact.frame_index == image.frame_index:
            yield PairedImage(image, exact)
            image = exact = None
    if image is not None:
        yield PairedImage(image, None)


def decode(data: bytes) -> GrayImage | None:
    """The gray image (H, W) in compressed bytes; None if there is none."""
    if not data:
        return None
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), _GRAY)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def detect_ahead(
    stream: Iterable[PairedImage | LogEvent],
    camera: Camera,
    build_detector: Callable[[], Detect],
    jobs: int,
) -> Iterator[DetectedImage | LogEvent]:
    """Decodes and detects in `jobs` threads, a few frames ahead; the order stays the log's."""
    # Each thread at work has a detector of its own.
    detectors: queue.SimpleQueue[Detect] = queue.SimpleQueue()
    for _ in range(jobs):
        detectors.put(build_detector())

    def detect(data: bytes) -> Detections | None:
        image = decode(data)
        if image is None or image.shape[::-1] != camera.image_size:
            return None
        detector = detectors.get()
        try:
            return detector(image)
        finally:
            detectors.put(detector)

    waiting: deque[tuple[PairedImage, Future[Detections | None]] | LogEvent] = deque()

    def next_finished() -> DetectedImage | LogEvent:
        first = waiting.popleft()
        if isinstance(first, LogEvent):
            return first
        paired, detections = first
        return DetectedImage(paired.image, paired.exact, detections.result())

    with ThreadPoolExecutor(jobs, thread_name_prefix="detect") as pool:
        try:
            for record in stream:
                if isinstance(record, LogEvent):
                    waiting.append(record)
                else:
                    waiting.append((record, pool.submit(detect, record.image.data)))
                while len(waiting) > 2 * jobs:
                    yield next_finished()
            while waiting:
                yield next_finished()
        finally:
            pool.shutdown(cancel_futures=True)
