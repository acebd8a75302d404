"""Ctrl-C at a moment that suits."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP
_STOPPING = tuple(signal.Signals[name] for name in _NAMES if hasattr(signal, name))


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C, termination and a lost terminal wait until the block is done: it happens whole."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Python runs signal handlers in the main thread only
        return
    waiting: list[tuple[int, FrameType | None]] = []

    def note(number: int, frame: FrameType | None) -> None:
        waiting.append((number, frame))

    # A handler that was not set from Python cannot be put back.
    before = {s: h for s in _STOPPING if (h := signal.getsignal(s)) is not None}
    for number in before:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for arrived, frame in waiting:
            _deliver(arrived, before[signal.Signals(arrived)], frame)


class StopRequest:
    """Whether somebody asked to stop."""

    made = False


@contextmanager
def stop_requests() -> Iterator[StopRequest]:
    """Ctrl-C, termination (a service being stopped) and a lost terminal only ask, inside.

    What was ignored before (`nohup`) stays ignored.
    """
    request = StopRequest()
    before: dict[signal.Signals, Any] = {}

    def ask(number: int, frame: FrameType | None) -> None:
        request.made = True

    if threading.current_thread() is threading.main_thread():
        for number in _STOPPING:
            handler = signal.getsignal(number)
            # One that was not set from Python cannot be put back.
            if handler not in (None, signal.SIG_IGN):
                before[number] = handler
                signal.signal(number, ask)
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _deliver(number: int, handler: Any, frame: FrameType | None) -> None:
    if callable(handler):
        handler(number, frame)
    elif handler == signal.SIG_DFL:
        signal.raise_signal(number)
