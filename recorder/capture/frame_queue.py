"""The one buffer between a source and its log."""

from __future__ import annotations

import threading
from collections import deque

from recorder.sources.base import CapturedFrame, SourceEvent

MAX_FRAMES = 300
MAX_BYTES = 64 << 20

Item = CapturedFrame | SourceEvent


class FrameQueue:
    """Frames and events in their order, at most `max_frames` of each and `max_bytes` of images.

    When it is full, a source that waits is held up; of one that does not, the newest frame is
    dropped, and an event before the next frame says how many. One frame always fits.
    """

    def __init__(
        self, *, waits: bool, max_frames: int = MAX_FRAMES, max_bytes: int = MAX_BYTES
    ) -> None:
        """`waits`: the source can be held up."""
        self._waits = waits
        self._max_frames = max_frames
        self._max_bytes = max_bytes
        self._items: deque[Item] = deque()
        self._frames = self._bytes = 0
        self._lost_frames = self._lost_events = 0
        self._lost_ns = 0
        self._closed = False
        self._refusing = False
        lock = threading.Lock()
        self._filled = threading.Condition(lock)
        self._taken = threading.Condition(lock)

    @property
    def frames(self) -> int:
        """Frames that wait to be written."""
        return self._frames

    @property
    def bytes(self) -> int:
        """Of these frames' images."""
        return self._bytes

    @property
    def lost_frames(self) -> int:
        """Frames dropped that no event has told of yet."""
        return self._lost_frames

    def put(self, item: Item) -> bool:
        """Adds an item, or counts it as dropped; False once nothing is taken any more."""
        with self._taken:
            while self._waits and not self._refusing and not self._has_space(item):
                self._taken.wait()
            if self._refusing:
                return False
            if self._has_space(item):
                self._tell_of_lost()
                self._append(item)
            elif isinstance(item, CapturedFrame):
                self._lost_frames += 1
                self._lost_ns = item.timestamp_ns
            else:
                self._lost_events += 1
                self._lost_frames += item.dropped
                self._lost_ns = item.timestamp_ns
            return True

    def get(self, timeout_s: float) -> Item | None:
        """The next item; None where none came in time, or none will: see `ended`."""
        with self._filled:
            if not self._items and not self._closed:
                self._filled.wait(timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
            if isinstance(item, CapturedFrame):
                self._frames -= 1
                self._bytes -= len(item.data)
            self._taken.notify()
            return item

    @property
    def ended(self) -> bool:
        """Nothing is in it and nothing will be."""
        return self._closed and not self._items

    def close(self) -> None:
        """Nothing more is added; what is there can still be taken."""
        with self._filled:
            if not self._closed:
                self._tell_of_lost()
            self._closed = self._refusing = True
            self._filled.notify_all()
            self._taken.notify_all()

    def give_up(self) -> int:
        """Nothing more is taken: how many frames were lost with it."""
        with self._filled:
            lost = self._frames + self._lost_frames
            lost += sum(item.dropped for item in self._items if isinstance(item, SourceEvent))
            self._items.clear()
            self._frames = self._bytes = self._lost_frames = 0
            self._closed = self._refusing = True
            self._filled.notify_all()
            self._taken.notify_all()
            return lost

    def _has_space(self, item: Item) -> bool:
        if isinstance(item, SourceEvent):
            # Outages are added up from these; they come seldom.
            if item.connected is not None:
                return True
            return len(self._items) - self._frames < self._max_frames
        fits = self._bytes + len(item.data) <= self._max_bytes
        return not self._frames or (fits and self._frames < self._max_frames)

    def _append(self, item: Item) -> None:
        self._items.append(item)
        if isinstance(item, CapturedFrame):
            self._frames += 1
            self._bytes += len(item.data)
        self._filled.notify()

    def _tell_of_lost(self) -> None:
        if not self._lost_frames and not self._lost_events:
            return
        text = f"{self._lost_frames} frames dropped: they came faster than they could be written"
        if self._lost_events:
            text += f" ({self._lost_events} messages of the source left out)"
        self._append(SourceEvent(self._lost_ns, "warning", text, dropped=self._lost_frames))
        self._lost_frames = self._lost_events = 0
