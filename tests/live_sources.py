"""Cameras that do not wait, made of frames."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping

from recorder.sources.base import CapturedFrame, SourceEvent
from tests.log_helpers import frame

Item = CapturedFrame | SourceEvent | BaseException


class LiveScript:
    """Gives what it was given, at once or at a rate; raises what is an exception.

    Attributes:
        given: frames handed over so far.
        held_up_s: the longest time that handing over one took.
    """

    name = "camera"

    def __init__(
        self,
        items: Iterable[Item],
        *,
        rate_hz: float | None = None,
        on_frame: Callable[[CapturedFrame], None] = lambda frame: None,
        stays: bool = False,
    ) -> None:
        """`stays`: after the last item there is silence until it is stopped."""
        self._items = items
        self._rate_hz = rate_hz
        self._on_frame = on_frame
        self._stays = stays
        self._stopped = threading.Event()
        self.given = 0
        self.held_up_s = 0.0

    def describe(self) -> dict[str, str]:
        return {"kind": "script", "clock": "none"}

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return {}

    @property
    def image_size(self) -> tuple[int, int]:
        return (64, 48)

    def frame_count(self) -> int | None:
        return None

    def preparation(self) -> str | None:
        return None

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        start = time.monotonic()
        for k, item in enumerate(self._items):
            if self._rate_hz is not None:
                self._stopped.wait(max(start + k / self._rate_hz - time.monotonic(), 0))
            if self._stopped.is_set():
                return
            if isinstance(item, BaseException):
                raise item
            before = time.monotonic()
            if isinstance(item, CapturedFrame):
                self.given += 1
                self._on_frame(item)
            yield item
            self.held_up_s = max(self.held_up_s, time.monotonic() - before)
        if self._stays:
            self._stopped.wait()

    def stop(self) -> None:
        self._stopped.set()


def now_frames(count: int | None = None, *, size: int = 2000) -> Iterator[CapturedFrame]:
    """Frames that are captured when they are taken."""
    index = 0
    pixels = frame(0, size=size)
    while count is None or index < count:
        now_ns = time.time_ns()
        yield CapturedFrame(index, now_ns, now_ns, pixels.data, "png")
        index += 1
