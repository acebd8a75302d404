"""Takes frames from a live source as a recorder does."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

from recorder.sources.base import CapturedFrame, LiveSource, SourceEvent


class Taker:
    """Reads a source in a thread of its own until the block ends.

    Attributes:
        stop_s: how long the source took to end.
    """

    def __init__(self, source: LiveSource) -> None:
        self.items: list[CapturedFrame | SourceEvent] = []
        self.error: BaseException | None = None
        self.stop_s = 0.0
        self._source = source
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def frames(self) -> list[CapturedFrame]:
        return [item for item in list(self.items) if isinstance(item, CapturedFrame)]

    @property
    def events(self) -> list[SourceEvent]:
        return [item for item in list(self.items) if isinstance(item, SourceEvent)]

    @property
    def messages(self) -> list[str]:
        return [event.message for event in self.events]

    def wait_for(self, count: int, timeout_s: float = 15.0) -> None:
        """Until there are this many frames."""
        until_s = time.monotonic() + timeout_s
        while len(self.frames) < count:
            assert time.monotonic() < until_s, (len(self.frames), self.messages)
            time.sleep(0.01)

    def wait_for_message(self, words: str, timeout_s: float = 15.0) -> None:
        until_s = time.monotonic() + timeout_s
        while not any(words in message for message in self.messages):
            assert time.monotonic() < until_s, (len(self.frames), self.messages)
            time.sleep(0.01)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        started_s = time.monotonic()
        self._source.stop()
        self._thread.join(10)
        self.stop_s = time.monotonic() - started_s
        assert not self._thread.is_alive()
        assert self.error is None, self.error

    def _run(self) -> None:
        try:
            self.items.extend(self._source.frames())
        except BaseException as error:
            self.error = error
