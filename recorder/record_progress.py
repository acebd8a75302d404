"""Shows how a recording goes on: a bar in a terminal, a line now and then in a file."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from types import TracebackType
from typing import Any, Never, Self

import click
from tqdm import tqdm

# Without a terminal: how often to say that all is well.
_ALIVE_S = 60.0
# What differs in its numbers alone is said again only after this time; it is in the log, and what
# is wrong with frames is counted.
_AGAIN_S = 10.0
# Short: in 80 columns there is to be room for what is counted.
_WITHOUT_END = "{{desc}} {{elapsed}}, {{n_fmt}} at {rate_hz:.1f}/s{{postfix}}"
# tqdm's rate hardly changes while a camera is lost.
_RATE_S = 2.0
_USUAL_SIZE = (80, 24)
# When a camera was gone is worth every line.
_CONNECTION = re.compile(r"connection lost|no connection|connected again")
_NUMBERS = re.compile(r"\d+(\.\d+)?")


class RecordProgress:
    """On stderr; use it in a `with` block.

    Problems are told in lines of their own, which stay. Where there is no terminal, and so no bar,
    it says once a minute how things stand, so that the journal of a service tells what happened.
    """

    def __init__(self, verb: str, total: int | None) -> None:
        """`total`: how many frames there will be, where that is known."""
        self._verb = verb
        told = _tells_its_size()
        self._size: dict[str, Any] = {
            "ncols": None if told else _USUAL_SIZE[0],
            "nrows": None if told else _USUAL_SIZE[1],
            "dynamic_ncols": told,
        }
        self._bar = tqdm(
            total=total,
            unit="frame",
            desc=verb,
            disable=None,
            **self._size,
        )
        self._line: tqdm[Never] | None = None
        self._recent: deque[tuple[float, int]] = deque([(time.monotonic(), 0)])
        self._told_at: dict[str, float] = {}
        self._alive_at = time.monotonic()

    def show(self, written: int, status: str, told: Iterable[str], more: str = "") -> None:
        """
        Args:
            written: frames.
            status: one line; what is at its end may be cut.
            told: what went wrong since the last call.
            more: another line.
        """
        for text in told:
            self._tell(text)
        if self._bar.disable:
            self._say_now_and_then(written, ", ".join(filter(None, (status, more))))
            return
        if self._bar.total is None:
            self._bar.bar_format = _WITHOUT_END.format(rate_hz=self._rate_hz(written))
        if more:
            if self._line is None:
                self._line = tqdm(bar_format="{desc}", position=1, leave=False, **self._size)
            self._line.set_description_str(more)
        self._bar.set_postfix_str(status, refresh=False)
        self._bar.update(written - self._bar.n)
        self._bar.refresh()

    def _rate_hz(self, written: int) -> float:
        """Of the last seconds."""
        now = time.monotonic()
        self._recent.append((now, written))
        while len(self._recent) > 2 and now - self._recent[1][0] > _RATE_S:
            self._recent.popleft()
        since, before = self._recent[0]
        return (written - before) / (now - since) if now > since else 0.0

    def _tell(self, text: str) -> None:
        if not _CONNECTION.match(text):
            now, kind = time.monotonic(), _NUMBERS.sub("#", text)
            if now < self._told_at.get(kind, -math.inf) + _AGAIN_S:
                return
            self._told_at[kind] = now
        tqdm.write(f"{self._verb}: {text}", file=sys.stderr)

    def _say_now_and_then(self, written: int, status: str) -> None:
        now = time.monotonic()
        if now - self._alive_at >= _ALIVE_S:
            self._alive_at = now
            click.echo(f"{self._verb}: {written} frames, {status}", err=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._line is not None:
            self._line.close()
        self._bar.close()


def _tells_its_size() -> bool:
    """Whether the terminal does; one on a serial line does not."""
    with suppress(OSError, ValueError):
        return os.get_terminal_size(sys.stderr.fileno()).columns > 0
    return True
