"""Single keys from the terminal, in a thread, with the terminal as it was at the end."""

from __future__ import annotations

import codecs
import os
import re
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Any, Self

try:
    import termios
    import tty
except ImportError:  # there are none on Windows
    termios = tty = None  # type: ignore[assignment]

_ENDING = (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM))
_LOOK_S = 0.2
_BYTES = 1024
_PIECE = re.compile(rb"\x1b(?:\[[0-9;?]*|O)?$")
_PIECE_S = 0.05


def has_keyboard() -> bool:
    """Whether standard input is a terminal that listens to us: no file, no background job."""
    if termios is None:
        return False
    try:
        return os.isatty(sys.stdin.fileno()) and _in_foreground(sys.stdin.fileno())
    except (AttributeError, OSError, ValueError):
        return False


class Keyboard:
    """Calls `on_keys` with what is typed and when, without waiting for Enter; use it in `with`.

    The terminal neither waits for lines nor echoes meanwhile; Ctrl-C and Ctrl-Z are what they were.
    It is as before when the block ends, and also when a signal ends the process. A job that is
    stopped and goes on in the background reads nothing.
    """

    def __init__(self, on_keys: Callable[[str, int], None]) -> None:
        """`on_keys`: gets characters and the system time, in a thread of its own."""
        self._on_keys = on_keys
        self._fd = sys.stdin.fileno()
        self._wake, self._waker = os.pipe()
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._before: list[Any] = []
        self._handlers: dict[int, Any] = {}
        self._given_back = False
        # A signal may come while it is held.
        self._lock = threading.RLock()
        self._thread = threading.Thread(target=self._read_all, name="keys", daemon=True)

    def __enter__(self) -> Self:
        self._before = termios.tcgetattr(self._fd)
        self._take_signals()
        try:
            self._single_keys()
        except BaseException:
            self._give_back()
            raise
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._give_back()
        os.write(self._waker, b".")
        self._thread.join(1.0)
        if not self._thread.is_alive():
            os.close(self._wake)
            os.close(self._waker)

    def _single_keys(self) -> None:
        """A shell sets its own modes while a job is stopped or in the background."""
        with self._lock:
            if self._given_back or not _in_foreground(self._fd):
                return
            if termios.tcgetattr(self._fd)[3] & termios.ICANON:
                tty.setcbreak(self._fd, termios.TCSANOW)

    def _give_back(self) -> None:
        with self._lock:
            self._given_back = True
            self._restore()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()

    def _restore(self) -> None:
        """What was typed for the recording is not left for the shell."""
        # In the background the terminal is somebody else's, who has set it as he needs it.
        if _in_foreground(self._fd):
            with suppress(termios.error):
                termios.tcflush(self._fd, termios.TCIFLUSH)
                termios.tcsetattr(self._fd, termios.TCSANOW, self._before)

    def _take_signals(self) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        for number in _ENDING:
            handler = signal.getsignal(number)
            # One that was not set from Python cannot be put back.
            if handler not in (None, signal.SIG_IGN):
                self._handlers[number] = handler
                signal.signal(number, self._end)

    def _end(self, number: int, frame: FrameType | None) -> None:
        handler = self._handlers.get(number, signal.SIG_DFL)
        self._give_back()
        if callable(handler):
            handler(number, frame)
        else:
            signal.raise_signal(number)

    def _read_all(self) -> None:
        while True:
            try:
                ready, _, _ = select.select([self._fd, self._wake], [], [], _LOOK_S)
                if self._wake in ready:
                    return
                self._single_keys()
                if not ready:
                    continue
                if not _in_foreground(self._fd):
                    # What is typed is the shell's; to read it would stop the recording.
                    time.sleep(_LOOK_S)
                    continue
                data = os.read(self._fd, _BYTES)
                # Arrow keys begin with the code of Esc; over a network they come in pieces.
                while _PIECE.search(data) and select.select([self._fd], [], [], _PIECE_S)[0]:
                    data += os.read(self._fd, _BYTES)
            except (OSError, termios.error):
                return
            if not data:
                return
            self._on_keys(self._decoder.decode(data), time.time_ns())


def _in_foreground(fd: int) -> bool:
    try:
        return os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:
        # A terminal that controls no jobs, or one that is gone.
        return True
