"""Lets as many frames in as can be tracked; what is recorded is what is tracked."""

from __future__ import annotations

import threading
from collections.abc import Iterator

from recorder.capture.source_thread import is_live
from recorder.errors import InputError
from recorder.sources.base import CapturedFrame, LiveSource, Source, SourceEvent
from recorder.sources.wrapped import WrappedSource

# As much as may wait, in memory; far below what the recorder's own queue takes.
_MAX_BYTES = 32 << 20


class Admission:
    """Counts the frames on their way through the pipeline, and their bytes.

    Attributes:
        closed: nothing is tracked any more; `failure` says why.
    """

    def __init__(self, max_frames: int, max_bytes: int = _MAX_BYTES) -> None:
        self._max_frames, self._max_bytes = max_frames, max_bytes
        self._frames = self._bytes = 0
        self._changed = threading.Condition()
        self.closed = False
        self.failure = ""

    def try_enter(self, size: int) -> bool:
        """Whether there is space for a frame; one always fits."""
        with self._changed:
            if not self._fits(size):
                return False
            self._frames += 1
            self._bytes += size
            return True

    def enter(self, size: int) -> bool:
        """Waits until there is; False when nothing is let in any more."""
        with self._changed:
            while not self.closed and not self._fits(size):
                self._changed.wait()
        return not self.closed and self.try_enter(size)

    def leave(self, size: int) -> None:
        """A frame is through."""
        with self._changed:
            self._frames -= 1
            self._bytes -= size
            self._changed.notify_all()

    def close(self, failure: str) -> None:
        """Nothing is let in any more."""
        with self._changed:
            self.closed = True
            self.failure = failure
            self._changed.notify_all()

    def _fits(self, size: int) -> bool:
        fits = self._frames < self._max_frames and self._bytes + size <= self._max_bytes
        return fits or not self._frames


class GatedSource(WrappedSource):
    """A source whose frames wait until they can be tracked.

    When they cannot be tracked any more that is an error: it can be read again.

    Attributes:
        dropped: frames that could not wait.
    """

    def __init__(self, source: Source, admission: Admission) -> None:
        super().__init__(source)
        self._admission = admission
        self.dropped = 0

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        frames = self._source.frames()
        try:
            for item in frames:
                if isinstance(item, SourceEvent) or self._admits(len(item.data)):
                    yield item
                elif self._admission.closed:
                    yield from self._untracked(item)
                else:
                    self.dropped += 1
                    text = f"frame {item.frame_index} dropped: the pipeline is too slow for it"
                    yield SourceEvent(item.timestamp_ns, "warning", text, dropped=1)
        finally:
            if close := getattr(frames, "close", None):
                close()

    def _admits(self, size: int) -> bool:
        return self._admission.enter(size)

    def _untracked(self, frame: CapturedFrame) -> Iterator[CapturedFrame | SourceEvent]:
        failure = self._admission.failure
        raise InputError(self.name, f"expected to track its frames, found: {failure}")


class LiveGatedSource(GatedSource):
    """The same of a source that does not wait: frames that come too fast are dropped.

    When they cannot be tracked any more they are recorded all the same: they come only once.
    """

    def __init__(self, source: LiveSource, admission: Admission) -> None:
        super().__init__(source, admission)
        self._live = source
        self._told = False

    def stop(self) -> None:
        """From another thread: let `frames` end."""
        self._live.stop()

    def _admits(self, size: int) -> bool:
        return not self._admission.closed and self._admission.try_enter(size)

    def _untracked(self, frame: CapturedFrame) -> Iterator[CapturedFrame | SourceEvent]:
        if not self._told:
            self._told = True
            text = f"tracking failed, recording goes on: {self._admission.failure}"
            yield SourceEvent(frame.timestamp_ns, "error", text)
        yield frame


def gated(source: Source | LiveSource, admission: Admission) -> GatedSource:
    """The source behind a gate; live if it was."""
    if is_live(source):
        return LiveGatedSource(source, admission)  # type: ignore[arg-type]
    return GatedSource(source, admission)
