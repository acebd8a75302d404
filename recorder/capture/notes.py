"""What people and programs have to say while a recording runs."""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Note:
    """One event for /events; stamps as those of frames."""

    timestamp_ns: int
    arrival_ns: int
    level: str
    message: str
    name: str


class Notes:
    """Takes events from any thread; the recording that it is given to writes them."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[Note] = queue.SimpleQueue()

    def add(
        self,
        message: str,
        *,
        level: str = "info",
        name: str = "operator",
        timestamp_ns: int | None = None,
    ) -> None:
        """Something that happened now, or at `timestamp_ns` of the capture clock."""
        now_ns = time.time_ns()
        stamp_ns = now_ns if timestamp_ns is None else timestamp_ns
        self._waiting.put(Note(stamp_ns, now_ns, level, message, name))

    def take(self) -> Iterator[Note]:
        """What was added since the last call."""
        while True:
            try:
                yield self._waiting.get_nowait()
            except queue.Empty:
                return
