"""The log's own events, on both timelines."""

from __future__ import annotations

from collections import deque

import rerun as rr

from recorder.log.records import LogEvent
from replay.viewer import scene, style


class LogEvents:
    """Gives each event the number of the last frame captured before it.

    Events and frames may come in any order; an event waits until a later frame comes.
    """

    def __init__(self, stream: rr.RecordingStream, start_ns: int) -> None:
        self._stream, self._start_ns = stream, start_ns
        self._waiting: deque[LogEvent] = deque()
        self._frame_index: int | None = None

    def add(self, event: LogEvent) -> None:
        self._waiting.append(event)

    def frame(self, timestamp_ns: int, frame_index: int) -> None:
        """A frame comes; the first one's number is also that of the events before it."""
        earlier = frame_index if self._frame_index is None else self._frame_index
        for _ in range(len(self._waiting)):
            event = self._waiting.popleft()
            if event.timestamp_ns < timestamp_ns:
                self._log(event, earlier)
            else:
                self._waiting.append(event)
        self._frame_index = frame_index

    def flush(self) -> None:
        """No frame comes any more."""
        while self._waiting:
            self._log(self._waiting.popleft(), self._frame_index)

    def _log(self, event: LogEvent, frame_index: int | None) -> None:
        scene.set_time(self._stream, event.timestamp_ns - self._start_ns, frame_index)
        text = f"{event.name}: {event.message}" if event.name else event.message
        scene.log_event(self._stream, style.EVENTS, text, event.level)
