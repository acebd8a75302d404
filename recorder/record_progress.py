"""Shows how a recording goes on: a bar in a terminal, a line now and then in a file."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Self

import click
from tqdm import tqdm

# Without a terminal: how often to say that all is well, and the same problem again.
_ALIVE_S = 60.0
_AGAIN_S = 10.0
_NUMBERS = re.compile(r"\d+(\.\d+)?")


class RecordProgress:
    """On stderr; use it in a `with` block.

    Where that is no terminal, each kind of problem is told when it comes, and how things stand once
    a minute, so that the journal of a service says what happened.
    """

    def __init__(self, verb: str, total: int | None) -> None:
        """`total`: how many frames there will be, where that is known."""
        self._verb = verb
        self._bar = tqdm(total=total, unit="frame", desc=verb, disable=None)
        self._told_at: dict[str, float] = {}
        self._alive_at = time.monotonic()

    def show(self, written: int, status: str, told: Iterable[str]) -> None:
        """`written`: frames; `status`: one line; `told`: what went wrong since the last call."""
        if self._bar.disable:
            self._say(written, status, told)
            return
        self._bar.set_postfix_str(status, refresh=False)
        self._bar.update(written - self._bar.n)
        self._bar.refresh()

    def _say(self, written: int, status: str, told: Iterable[str]) -> None:
        now = time.monotonic()
        for text in told:
            kind = _NUMBERS.sub("#", text)
            if kind not in self._told_at or now >= self._told_at[kind] + _AGAIN_S:
                self._told_at[kind] = now
                click.echo(f"{self._verb}: {text}", err=True)
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
