"""Waypoint keys while a recording runs."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from recorder.bench.clock import CaptureClock, WatchedSource
from recorder.bench.keyboard import Keyboard, has_keyboard
from recorder.bench.keys import KEYS, KeyInput
from recorder.bench.marking import Marking
from recorder.capture.notes import Notes
from recorder.capture.source_thread import is_live
from recorder.files.truth_file import Waypoint, parse_truth
from recorder.log import topics
from recorder.sources.base import LiveSource, Source


class Bench:
    """What a recording takes from the bench; without keys, nothing.

    Attributes:
        source: in place of the one that was given.
        notes: what the operator marks.
    """

    def __init__(self, source: Source | LiveSource) -> None:
        self.source = source
        self.notes: Notes | None = None

    def refresh(self) -> None:
        """Show where things are, now."""


class _Keys(Bench):
    """With a line of its own on the screen, below the progress of the recording."""

    def __init__(self, source: LiveSource, names: tuple[str, ...]) -> None:
        self._clock = CaptureClock(source.describe().get("clock", ""))
        self._told = Notes()
        self._marking = Marking(self._told, self._clock, names)
        self._input = KeyInput(self._marking)
        self._line = tqdm(bar_format="{desc}", position=1, leave=False, disable=None)
        super().__init__(WatchedSource(source, self._clock, self._marking.end))
        self.notes = self._told

    def begin(self) -> None:
        self._say(KEYS)
        self.refresh()

    def press(self, text: str, system_ns: int) -> None:
        for said in self._input.feed(text, system_ns):
            self._say(said)
        self.refresh()

    def refresh(self) -> None:
        if self._input.entry is not None:
            kind, typed = self._input.entry
            text = f"{kind}: {typed}_ (Enter, Esc)"
        else:
            text = f"{self._marking.status(time.time_ns())}; ? for keys"
        columns = shutil.get_terminal_size().columns
        self._line.set_description_str(text[: columns - 1])

    def end(self) -> None:
        self._line.close()

    def _say(self, text: str) -> None:
        tqdm.write(text, file=sys.stderr)


@contextmanager
def waypoint_keys(
    source: Source | LiveSource, attachments: Mapping[str, bytes], *, wanted: bool
) -> Iterator[Bench]:
    """Reads keys while the block runs, if `source` is a live one and there is a terminal.

    The frames of a file were taken at another time than now: there is nothing to mark in them.

    Args:
        attachments: of the log; the waypoints of a truth.yaml have their names from it.
        wanted: False: no keys, whatever there is.
    """
    if not wanted or not is_live(source) or not has_keyboard():
        yield Bench(source)
        return
    names = tuple(w.name for w in _waypoints({**source.attachments, **attachments}))
    keys = _Keys(source, names)  # type: ignore[arg-type]  # a live source
    try:
        with Keyboard(keys.press):
            keys.begin()
            yield keys
    finally:
        keys.end()


def keys_remark(source: Source | LiveSource, attachments: Mapping[str, bytes]) -> str | None:
    """Why waypoints that somebody measured cannot be marked, for people."""
    if is_live(source) or not _waypoints({**source.attachments, **attachments}):
        return None
    return (
        "truth.yaml has waypoints; keys mark them only while a live camera records, not in a file"
    )


def _waypoints(attachments: Mapping[str, bytes]) -> tuple[Waypoint, ...]:
    data = attachments.get(topics.TRUTH_FILES[0])
    return parse_truth(data, Path(topics.TRUTH_FILES[0])).waypoints if data else ()
