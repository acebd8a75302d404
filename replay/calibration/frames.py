"""The images to calibrate from: those of a log, a folder or a video, some hundreds at most."""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypeVar

from pipeline.detection import GrayImage
from recorder.errors import InputError
from recorder.image_decoding import decode_gray
from recorder.log.reader import LogReader
from recorder.log.records import LogImage
from recorder.sources.base import CapturedFrame
from recorder.sources.images import ImagesSource
from recorder.sources.live.http_mjpeg import without_password
from recorder.sources.opening import SourceOptions, open_source

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Frame:
    """One compressed image and what to call it."""

    name: str
    data: bytes


class Frames:
    """The images of a source, evenly thinned to at most `most`; they can be gone through again.

    Attributes:
        total: images of the source.
        every: each so many of them is looked at.
        warning: what a person should know, once the frames have been gone through: a log cut
            short.
    """

    def __init__(self, source: str | Path, most: int) -> None:
        """Counts the images.

        Raises:
            InputError: no log, folder or video, or nothing in it.
        """
        text = str(source)
        self.source = source = Path(source)
        self.warning: str | None = None
        if text.startswith("/dev/") or re.match(r"[a-z]+://", text):
            raise InputError(
                without_password(text),
                "expected a log, a folder of images or a video; record a live camera first",
            )
        if not source.exists():
            raise InputError(
                source, "expected a log, a folder of images or a video, found nothing there"
            )
        self._read: Callable[[], Iterator[Frame]]
        if source.suffix.lower() == ".mcap":
            self._read = self._of_log
            self.total = LogReader(source).image_count() or sum(1 for _ in self._of_log())
        elif source.is_dir():
            images = ImagesSource(source)
            self._read = lambda: self._of_source(images.frames(), images.files)
            self.total = images.frame_count() or 0
        else:
            opened = open_source(text, SourceOptions())
            self._read = lambda: self._of_source(open_source(text).frames(), ())
            self.total = opened.frame_count() or sum(1 for _ in self._read())
        if not self.total:
            raise InputError(source, "expected images, found none")
        self.every = -(-self.total // most)

    def __len__(self) -> int:
        """How many are looked at."""
        return -(-self.total // self.every)

    def __iter__(self) -> Iterator[Frame]:
        return islice(self._read(), 0, None, self.every)

    def images(self) -> Iterator[GrayImage]:
        """Those that can be decoded, one after the other."""
        decoded = (decode_gray(frame.data) for frame in self)
        return (image for image in decoded if image is not None)

    def map(self, work: Callable[[GrayImage | None], T]) -> Iterator[tuple[Frame, T]]:
        """Each frame with what `work` makes of its image, in order; done in threads, ahead."""
        jobs = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        with ThreadPoolExecutor(jobs, thread_name_prefix="corners") as pool:
            waiting: deque[tuple[Frame, Future[T]]] = deque()
            try:
                for frame in self:
                    waiting.append(
                        (frame, pool.submit(lambda data: work(decode_gray(data)), frame.data))
                    )
                    if len(waiting) > 2 * jobs:
                        first, done = waiting.popleft()
                        yield first, done.result()
                for first, done in waiting:
                    yield first, done.result()
            finally:
                pool.shutdown(cancel_futures=True)

    def _of_log(self) -> Iterator[Frame]:
        reader = LogReader(self.source)
        start_ns = reader.start_ns or 0
        for record in reader.records():
            if isinstance(record, LogImage):
                seconds = (record.timestamp_ns - start_ns) * 1e-9
                yield Frame(f"frame {record.frame_index} ({seconds:.2f} s)", record.data)
        self.warning = reader.shortfall

    def _of_source(self, frames: Iterable[object], files: tuple[Path, ...]) -> Iterator[Frame]:
        for frame in frames:
            if isinstance(frame, CapturedFrame):
                i = frame.frame_index
                yield Frame(files[i].name if files else f"frame {i}", frame.data)
