"""A command in a terminal of its own, as if a person sat before it."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from fcntl import ioctl
from types import TracebackType
from typing import Any, Self

from tests.conftest import ROOT

# The child makes the terminal its own, so that Ctrl-C and job control work as in a shell.
_LAUNCH = (
    "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
)


class Terminal:
    """Runs `python ARGUMENTS` with a pseudo-terminal for input and output; use it in `with`.

    Attributes:
        text: all that was shown so far.
    """

    def __init__(self, arguments: Sequence[str], *, columns: int = 120) -> None:
        """`columns`: 0 for a terminal that does not tell its size."""
        self.text = ""
        self._seen = 0
        self._master, self._slave = pty.openpty()
        ioctl(
            self._slave,
            termios.TIOCSWINSZ,
            struct.pack("HHHH", 30 if columns else 0, columns, 0, 0),
        )
        self.before = termios.tcgetattr(self._slave)
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LAUNCH, *arguments],
            stdin=self._slave,
            stdout=self._slave,
            stderr=self._slave,
            start_new_session=True,
            cwd=ROOT,
        )

    @property
    def modes(self) -> list[Any]:
        """The terminal's, now."""
        return termios.tcgetattr(self._slave)

    @property
    def echoes(self) -> bool:
        """It shows what is typed and waits for lines, as a shell expects it."""
        local: int = self.modes[3]
        return bool(local & termios.ECHO) and bool(local & termios.ICANON)

    @property
    def lines(self) -> list[str]:
        """What was shown, without the moves of the cursor."""
        return [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", t) for t in re.split(r"[\r\n]+", self.text)]

    def set_modes(self, modes: list[Any]) -> None:
        termios.tcsetattr(self._slave, termios.TCSANOW, modes)

    def press(self, text: str) -> None:
        os.write(self._master, text.encode())

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def wait_for(self, pattern: str, timeout_s: float = 30.0) -> None:
        """Until a regular expression matches in what was shown since the last call."""
        until_s = time.monotonic() + timeout_s
        begin = self._seen
        while (match := re.compile(pattern).search(self.text, begin)) is None:
            if time.monotonic() > until_s or not self._read(0.05):
                raise AssertionError(f"no {pattern!r} in {self.text[begin:]!r}")
        self._seen = match.end()

    def wait(self, timeout_s: float = 30.0) -> int:
        """Until the command ends; returns its exit code."""
        until_s = time.monotonic() + timeout_s
        while self._process.poll() is None:
            assert time.monotonic() < until_s, self.text
            self._read(0.05)
        while select.select([self._master], [], [], 0.1)[0] and self._read(0.0):
            pass
        return self._process.returncode

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        os.close(self._slave)
        os.close(self._master)

    def _read(self, timeout_s: float) -> bool:
        """Takes what there is to show; False at the end."""
        if select.select([self._master], [], [], timeout_s)[0]:
            try:
                self.text += os.read(self._master, 65536).decode("utf-8", "replace")
            except OSError:
                return False
        return True
