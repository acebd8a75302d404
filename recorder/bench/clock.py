"""The clock of a camera's capture times, read when a key is pressed."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.sources.wrapped import WrappedSource

if TYPE_CHECKING:
    from collections.abc import Callable

    from recorder.sources.base import LiveSource

_FRAMES = 100
# How the names of clocks begin that are the system's: of arrivals, and of the kernel's stamps.
_SYSTEM_CLOCKS = ("arrival", "kernel")


class CaptureClock:
    """Turns system time into capture time.

    The clocks of most sources are the system's. Where the camera or its server has stamped the
    frames, the difference is the least by which the last hundred frames arrived after their
    capture: too much by what the fastest of them was on its way, too little by nothing.

    Attributes:
        start_ns: capture time of the first frame, from which the seconds of the log count.
        last_ns: that of the last one.
    """

    def __init__(self, name: str) -> None:
        """`name`: as a live source describes its clock."""
        self._is_system = name.startswith(_SYSTEM_CLOCKS)
        self._lags_ns: deque[int] = deque(maxlen=_FRAMES)
        self._lock = threading.Lock()
        self.start_ns: int | None = None
        self.last_ns: int | None = None

    def see(self, timestamp_ns: int, arrival_ns: int) -> None:
        """A frame's capture and its arrival by the system clock."""
        with self._lock:
            if self.start_ns is None:
                self.start_ns = timestamp_ns
            self.last_ns = timestamp_ns
            self._lags_ns.append(arrival_ns - timestamp_ns)

    def capture_ns(self, system_ns: int) -> int:
        """The capture time of a frame that is taken at `system_ns`."""
        with self._lock:
            if self._is_system or not self._lags_ns:
                return system_ns
            return system_ns - min(self._lags_ns)


class WatchedSource(WrappedSource):
    """A live source whose frames pass by a clock; all else is as of the source."""

    def __init__(self, source: LiveSource, clock: CaptureClock, on_end: Callable[[], None]) -> None:
        """`on_end`: called after the last frame, before the log is told that it was the last."""
        super().__init__(source)
        self._live = source
        self._clock = clock
        self._on_end = on_end

    def stop(self) -> None:
        self._live.stop()

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        frames = self._source.frames()
        try:
            for item in frames:
                yield item
                # Afterwards: one that is refused because the recording ends is not in the log.
                if isinstance(item, CapturedFrame):
                    self._clock.see(item.timestamp_ns, item.arrival_ns)
        finally:
            if close := getattr(frames, "close", None):
                close()
            self._on_end()
