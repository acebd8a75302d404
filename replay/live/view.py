"""The newest frames in a viewer, as far as it keeps up; nothing here ever makes others wait."""

from __future__ import annotations

import multiprocessing
import threading
import time
from contextlib import suppress
from types import TracebackType
from typing import Self

from pipeline.localizer import FrameResult
from recorder.sources.base import CapturedFrame
from replay.live.address import Address
from replay.live.child import Shown, ViewSetup, run

# More frames a second than this tell nobody more, and cost the machine that records.
_RATE_HZ = 15.0
# When to look again for a viewer: one that is not there, one that was lost.
_LOOK_S = 0.5
_PAUSE_S = 5.0
_POLL_S = 0.1
# How long the last frame may take, at the end.
_LAST_S = 1.5


class ViewLostError(Exception):
    """The viewer is of no more use."""


class LiveView:
    """Shows frames in a viewer; use it in a `with` block.

    A process of its own does the work. A viewer that is not there, or not any more, is looked for
    until it is.

    Attributes:
        shown: frames that the viewer has; `missed`: those that it will not get.
        problem: why nothing is shown; None while something is.
    """

    def __init__(self, address: Address, setup: ViewSetup) -> None:
        self._address, self._setup = address, setup
        self._waiting: Shown | None = None
        self._start_ns: int | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._child: _Child | None = None
        self._thread = threading.Thread(target=self._run, name="live view", daemon=True)
        self.shown = self.missed = 0
        self.problem: str | None = None

    def offer(self, frame: CapturedFrame, result: FrameResult | None = None) -> None:
        """The next frame; takes the place of one that was not shown yet. Returns at once."""
        with self._changed:
            if self._start_ns is None:
                self._start_ns = frame.timestamp_ns
            self.missed += self._waiting is not None or self._closed
            self._waiting = Shown(frame, result, self._start_ns)
            self._changed.notify_all()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join(2 * _LAST_S)
        if self._child is not None:
            self._child.kill()
            self._thread.join(_LAST_S)

    def _run(self) -> None:
        while self._has_viewer():
            shown = self._next()
            if shown is None:
                break
            started = time.monotonic()
            try:
                self._show(shown)
            except (ViewLostError, OSError, EOFError) as lost:
                self._lose(str(lost) or "the viewer is gone")
            else:
                self.shown += 1
                self.problem = None
            self._wait(started + 1 / _RATE_HZ - time.monotonic())
        with self._changed:
            self.missed += self._waiting is not None
            self._waiting = None
        if self._child is not None:
            self._child.close()

    def _has_viewer(self) -> bool:
        """Waits until there is one; False when it is over."""
        while self._child is None:
            if self._closed:
                return False
            if not self._address.listens():
                self.problem = f"nobody listens at {self._address}"
                self._wait(_LOOK_S)
                continue
            try:
                self._child = _Child(self._address.url, self._setup)
            except OSError as error:
                self.problem = str(error)
                self._wait(_PAUSE_S)
        return True

    def _next(self) -> Shown | None:
        """The newest frame; None when no more will come."""
        with self._changed:
            while self._waiting is None and not self._closed:
                self._changed.wait()
            shown, self._waiting = self._waiting, None
            return shown

    def _show(self, shown: Shown) -> None:
        child = self._child
        if child is None:
            raise ViewLostError
        child.send(shown)
        deadline: float | None = None
        while not child.has_answer(_POLL_S):
            if self._closed:
                deadline = deadline or time.monotonic() + _LAST_S
                if time.monotonic() > deadline:
                    raise ViewLostError("the viewer takes nothing any more")
        if (problem := child.answer()) is not None:
            raise ViewLostError(problem)

    def _lose(self, problem: str) -> None:
        with self._changed:
            self.missed += 1
        self.problem = problem
        if self._child is not None:
            self._child.kill()
            self._child = None
        self._wait(_PAUSE_S)

    def _wait(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        with self._changed:
            while not self._closed and (left := until - time.monotonic()) > 0:
                self._changed.wait(left)


class _Child:
    """The process that draws."""

    def __init__(self, url: str, setup: ViewSetup) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=run, args=(theirs, url, setup), daemon=True)
        self._process.start()
        # Only then does its end show here.
        theirs.close()

    def send(self, shown: Shown) -> None:
        self._connection.send(shown)

    def has_answer(self, timeout_s: float) -> bool:
        return self._connection.poll(timeout_s)

    def answer(self) -> str | None:
        """Why the last frame was not shown; None if it was."""
        answer: str | None = self._connection.recv()
        return answer

    def close(self) -> None:
        """It has shown everything; let it end."""
        self._connection.close()
        self._process.join(_LAST_S)
        self.kill()

    def kill(self) -> None:
        with suppress(ValueError, OSError):
            self._process.kill()
            self._process.join()
