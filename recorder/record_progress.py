"""Shows how a recording goes on: a bar in a terminal, a line now and then in a file."""

from __future__ import annotations

import math
import os
import re
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from types import TracebackType
from typing import Self

import click
from tqdm import tqdm

# Without a terminal: how often to say that all is well.
_ALIVE_S = 60.0
# What differs in its numbers alone is said again only after this time; it is in the log, and what
# is wrong with frames is counted.
_AGAIN_S = 10.0
# Short: in 80 columns there is to be room for what is counted.
_WITHOUT_END = "{desc} {elapsed}, {n_fmt} at {rate_noinv_fmt}{postfix}"
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
        endless, told = total is None, _tells_its_size()
        self._bar = tqdm(
            total=total,
            unit="" if endless else "frame",
            desc=verb,
            disable=None,
            ncols=None if told else _USUAL_SIZE[0],
            nrows=None if told else _USUAL_SIZE[1],
            dynamic_ncols=told,
            bar_format=_WITHOUT_END if endless else None,
        )
        self._told_at: dict[str, float] = {}
        self._alive_at = time.monotonic()

    def show(self, written: int, status: str, told: Iterable[str]) -> None:
        """`written`: frames; `status`: one line; `told`: what went wrong since the last call."""
        for text in told:
            self._tell(text)
        if self._bar.disable:
            self._say_now_and_then(written, status)
            return
        self._bar.set_postfix_str(status, refresh=False)
        self._bar.update(written - self._bar.n)
        self._bar.refresh()

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
        self._bar.close()


def _tells_its_size() -> bool:
    """Whether the terminal does; one on a serial line does not."""
    with suppress(OSError, ValueError):
        return os.get_terminal_size(sys.stderr.fileno()).columns > 0
    return True
