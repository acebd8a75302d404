"""Shows frames while they are recorded, as far as the viewer keeps up."""

from __future__ import annotations

import threading
from collections.abc import Callable

from recorder.sources.base import CapturedFrame

FrameSink = Callable[[CapturedFrame], None]


class SinkThread(threading.Thread):
    """Calls one sink with the newest frame, again and again.

    A sink that is slower than a live source misses frames: they are counted. With a source that
    waits it gets every frame. One that raises is not called again.

    Attributes:
        error: what it raised.
    """

    def __init__(self, sink: FrameSink, *, waits: bool) -> None:
        """`waits`: the source can be held up."""
        super().__init__(name="sink", daemon=True)
        self._sink = sink
        self._waits = waits
        self._frame: CapturedFrame | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._dropped = 0
        self.error: BaseException | None = None

    @property
    def dropped(self) -> int:
        """Frames it missed, with those that the sink says it did not show: its `missed`."""
        missed: int = getattr(self._sink, "missed", 0)
        return self._dropped + missed

    def offer(self, frame: CapturedFrame) -> None:
        """The next frame; takes the place of one that was not shown yet."""
        with self._changed:
            while self._waits and self._frame is not None and not self._ended:
                self._changed.wait()
            if self._frame is not None or self._ended:
                self._dropped += 1
            if not self._ended:
                self._frame = frame
            self._changed.notify_all()

    @property
    def _ended(self) -> bool:
        return self._closed or self.error is not None

    def close(self, timeout_s: float) -> None:
        """Let it show the last frame and end; wait so long for that."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self.is_alive():
            self.join(timeout_s)

    def run(self) -> None:
        while True:
            with self._changed:
                while self._frame is None and not self._closed:
                    self._changed.wait()
                frame, self._frame = self._frame, None
                self._changed.notify_all()
            if frame is None:
                return
            try:
                self._sink(frame)
            except BaseException as error:
                with self._changed:
                    self.error = error
                    self._changed.notify_all()
                return
