"""A log's records on their way to the tracker: decoded and detected ahead, in the log's order."""

from __future__ import annotations

import os
import queue
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import cv2

from pipeline.camera import Camera
from pipeline.detection import Detections, GrayImage
from recorder.image_decoding import decode_gray
from recorder.log.records import ExactPose, LogEvent, LogImage

Detect = Callable[[GrayImage], Detections]


@dataclass(frozen=True, eq=False)
class PairedImage:
    """An image with its exact pose, where the log has one."""

    image: LogImage
    exact: ExactPose | None


@dataclass(frozen=True, eq=False)
class DetectedImage:
    """A paired image with its detections; None where it is no whole image of the camera's size."""

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


class DetectorPool:
    """Threads that decode and detect, each with a detector of its own; use it in a `with` block."""

    def __init__(self, camera: Camera, build_detector: Callable[[], Detect], jobs: int) -> None:
        self._camera = camera
        self._detectors: queue.SimpleQueue[Detect] = queue.SimpleQueue()
        for _ in range(jobs):
            self._detectors.put(build_detector())
        self._pool = ThreadPoolExecutor(jobs, thread_name_prefix="detect")

    def submit(self, data: bytes) -> Future[Detections | None]:
        """The detections in a compressed image; None where it is none of the camera's size."""
        return self._pool.submit(self._detect, data)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown(cancel_futures=True)

    def _detect(self, data: bytes) -> Detections | None:
        image = decode_gray(data, self._camera.image_size)
        if image is None:
            return None
        detector = self._detectors.get()
        try:
            return detector(image)
        finally:
            self._detectors.put(detector)


def detect_ahead(
    stream: Iterable[PairedImage | LogEvent],
    camera: Camera,
    build_detector: Callable[[], Detect],
    jobs: int,
) -> Iterator[DetectedImage | LogEvent]:
    """Decodes and detects in `jobs` threads, a few frames ahead; the order stays the log's."""
    waiting: deque[tuple[PairedImage, Future[Detections | None]] | LogEvent] = deque()

    def next_finished() -> DetectedImage | LogEvent:
        first = waiting.popleft()
        if isinstance(first, LogEvent):
            return first
        paired, detections = first
        return DetectedImage(paired.image, paired.exact, detections.result())

    with DetectorPool(camera, build_detector, jobs) as pool:
        for record in stream:
            if isinstance(record, LogEvent):
                waiting.append(record)
            else:
                waiting.append((record, pool.submit(record.image.data)))
            while len(waiting) > 2 * jobs:
                yield next_finished()
        while waiting:
            yield next_finished()


def cores() -> int:
    """Those that this process may use, where the system tells."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def opencv_threads(count: int | None) -> Iterator[None]:
    """OpenCV with `count` threads of its own; beside ours, more get in the way."""
    before = cv2.getNumThreads()
    if count is not None:
        cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
