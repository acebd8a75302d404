"""Takes frames from their source, and does nothing else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from recorder.capture.frame_queue import FrameQueue
from recorder.sources.base import CapturedFrame, LiveSource, Source


def is_live(source: Source) -> bool:
    """Whether frames that are not taken in time are lost."""
    return callable(getattr(source, "stop", None))


class SourceThread(threading.Thread):
    """Puts what `source` gives into `queue`, until it ends, is told to or time is up.

    Attributes:
        error: what the source raised.
        timed_out: `duration_s` is over.
    """

    def __init__(
        self,
        source: Source | LiveSource,
        queue: FrameQueue,
        *,
        should_stop: Callable[[], bool],
        duration_s: float | None = None,
    ) -> None:
        """`duration_s` counts from the first frame: by the clock for a live source, else by the
        frames' own times."""
        super().__init__(name="source", daemon=True)
        self._source = source
        self._queue = queue
        self._should_stop = should_stop
        self._live = is_live(source)
        self._duration_ns = None if duration_s is None else round(duration_s * 1e9)
        self._first_ns: int | None = None
        self.error: BaseException | None = None
        self.timed_out = False

    def run(self) -> None:
        try:
            self._take_all()
        except BaseException as error:
            self.error = error
        finally:
            self._queue.close()

    def is_over_time(self) -> bool:
        """Whether the duration is over, also while nothing arrives."""
        if self._live and self._first_ns is not None and self._duration_ns is not None:
            self.timed_out |= time.monotonic_ns() - self._first_ns >= self._duration_ns
        return self.timed_out

    def stop(self) -> None:
        """From another thread: let a live source end."""
        if self._live:
            self._source.stop()  # type: ignore[union-attr]

    def _take_all(self) -> None:
        frames = self._source.frames()
        try:
            for item in frames:
                if self._should_stop() or (
                    isinstance(item, CapturedFrame) and self._is_too_late(item)
                ):
                    return
                if not self._queue.put(item):
                    return
        finally:
            if close := getattr(frames, "close", None):
                close()

    def _is_too_late(self, frame: CapturedFrame) -> bool:
        now_ns = time.monotonic_ns() if self._live else frame.arrival_ns
        if self._first_ns is None:
            self._first_ns = now_ns
        if self._duration_ns is not None and now_ns - self._first_ns >= self._duration_ns:
            self.timed_out = True
        return self.timed_out
