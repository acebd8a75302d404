"""Looks for damage inside images while they are recorded, for a small part of a core."""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from recorder.image_decoding import flaw
from recorder.sources.base import CapturedFrame

# Of the time of one core: at 30 frames/s enough for four of five images of 1280x720 and 120 kB,
# for every third of 1920x1080 and 300 kB.
_SHARE = 0.03
# Frames that come at once, after a pause, wait; of more than these the newest.
_WAITING = 30


class Inspected(NamedTuple):
    """A frame that was looked into; `flaw` is what was found, None where it is whole."""

    frame_index: int
    timestamp_ns: int
    flaw: str | None


class InspectionThread(threading.Thread):
    """Decodes a frame, rests until that was its share of the time, and so on.

    Attributes:
        error: what stopped it.
    """

    def __init__(self) -> None:
        super().__init__(name="inspection", daemon=True)
        self._frames: deque[CapturedFrame] = deque(maxlen=_WAITING)
        self._closed = False
        self._changed = threading.Condition()
        self._found: queue.SimpleQueue[Inspected] = queue.SimpleQueue()
        self.error: BaseException | None = None

    def offer(self, frame: CapturedFrame) -> None:
        """The next frame; where too many wait, it takes the place of the oldest."""
        with self._changed:
            self._frames.append(frame)
            self._changed.notify()

    def take(self) -> Iterator[Inspected]:
        """What was found since the last call."""
        while True:
            try:
                yield self._found.get_nowait()
            except queue.Empty:
                return

    def close(self) -> None:
        """Looks into the frames that wait, and ends."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self.join()

    def run(self) -> None:
        try:
            while (frame := self._next()) is not None:
                used_s = time.thread_time()
                found = flaw(frame.data, frame.format)
                self._found.put(Inspected(frame.frame_index, frame.timestamp_ns, found))
                used_s = time.thread_time() - used_s
                self._rest(used_s / _SHARE - used_s)
        except BaseException as error:
            self.error = error

    def _next(self) -> CapturedFrame | None:
        with self._changed:
            self._changed.wait_for(lambda: self._frames or self._closed)
            return self._frames.popleft() if self._frames else None

    def _rest(self, seconds: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._closed, seconds)
