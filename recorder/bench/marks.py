"""Waypoints as they stand in a log: one line of text on /events for each mark.

| text | what |
|---|---|
| `arrived at NAME` | the camera is at the waypoint at the event's capture time |
| `standing still at NAME from S` | it stands there, and has not moved on yet |
| `standing still at NAME from S to S` | it stood there; in place of the line without an end |
| `undone: arrived at NAME at S` | an earlier mark does not count |
| `undone: standing still at NAME from S` or `… from S to S` | the same |
| `note: TEXT` | in the operator's words; no mark |

S are seconds of the log with three decimals, counted from the first image's capture stamp; NAME is
one word.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from recorder.errors import InputError
from recorder.log import topics

if TYPE_CHECKING:
    from recorder.log.reader import LogReader

_NAME = r"(?P<name>\S+)"
_S = r"-?\d+\.\d{3}"
_ARRIVED = re.compile(rf"arrived at {_NAME}")
_STANDING = re.compile(rf"standing still at {_NAME} from (?P<from_s>{_S})(?: to (?P<to_s>{_S}))?")
_UNDONE = re.compile(
    rf"undone: (?:arrived at {_NAME} at (?P<at_s>{_S})|(?P<standing>standing still at .*))"
)


@dataclass(frozen=True)
class Mark:
    """The camera was at a waypoint.

    Attributes:
        from_s: in seconds of the log, to the millisecond.
        to_s: equal to `from_s` for an arrival; None where standing still was not ended.
        stood: it stood still from `from_s` to `to_s`.
        undone: the operator took it back.
    """

    name: str
    from_s: float
    to_s: float | None
    stood: bool
    undone: bool = False

    def text(self) -> str:
        """The line that a log has for it."""
        if not self.stood:
            return f"arrived at {self.name}"
        text = f"standing still at {self.name} from {self.from_s:.3f}"
        return text if self.to_s is None else f"{text} to {self.to_s:.3f}"

    def undone_text(self) -> str:
        """The line that takes it back."""
        at = "" if self.stood else f" at {self.from_s:.3f}"
        return f"undone: {self.text()}{at}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class MarkReader:
    """Collects the marks from a log's events, in whoever's name they are."""

    def __init__(self, start_ns: int) -> None:
        """`start_ns`: capture stamp of the log's first image."""
        self._start_ns = start_ns
        self._marks: list[Mark] = []

    @property
    def marks(self) -> tuple[Mark, ...]:
        """In the order in which they were begun; those undone too."""
        return tuple(self._marks)

    def add(self, timestamp_ns: int, text: str) -> None:
        """The next event; one that is no mark is passed over."""
        if match := _ARRIVED.fullmatch(text):
            at_s = log_seconds(timestamp_ns, self._start_ns)
            self._marks.append(Mark(match["name"], at_s, at_s, stood=False))
        elif match := _STANDING.fullmatch(text):
            self._add_standing(_standing(match))
        elif match := _UNDONE.fullmatch(text):
            self._undo(match)

    def _add_standing(self, mark: Mark) -> None:
        i = self._find(replace(mark, to_s=None))
        if mark.to_s is None or i is None:
            self._marks.append(mark)
        else:
            self._marks[i] = mark

    def _undo(self, match: re.Match[str]) -> None:
        if match["standing"]:
            inner = _STANDING.fullmatch(match["standing"])
            mark = _standing(inner) if inner else None
        else:
            at_s = float(match["at_s"])
            mark = Mark(match["name"], at_s, at_s, stood=False)
        i = self._find(mark) if mark else None
        if i is not None:
            self._marks[i] = replace(self._marks[i], undone=True)

    def _find(self, mark: Mark) -> int | None:
        """The last such mark that counts."""
        found = (i for i in range(len(self._marks) - 1, -1, -1) if self._marks[i] == mark)
        return next(found, None)


def is_mark(text: str) -> bool:
    """Whether a line marks something, or takes that back."""
    return any(line.fullmatch(text) for line in (_ARRIVED, _STANDING, _UNDONE))


def log_marks(log: LogReader) -> tuple[Mark, ...]:
    """The marks of a log; reads all of it.

    Raises:
        InputError: an event that is not what its schema says.
    """
    from foxglove_schemas_protobuf.Log_pb2 import Log
    from google.protobuf.message import DecodeError

    from recorder.log import messages

    reader = MarkReader(log.start_ns or 0)
    for _, channel, message in log.messages():
        if channel.topic != topics.EVENTS:
            continue
        try:
            timestamp_ns, _, text, _ = messages.from_event(Log.FromString(message.data))
        except DecodeError as error:
            raise InputError(
                log.path, "expected foxglove.Log, found other bytes", topics.EVENTS
            ) from error
        reader.add(timestamp_ns, text)
    return reader.marks


def log_seconds(timestamp_ns: int, start_ns: int) -> float:
    """A capture time in seconds of the log, to the millisecond."""
    return round((timestamp_ns - start_ns) / 1e6) / 1e3


def marks_text(marks: Iterable[Mark]) -> str:
    """One line on the marks of a log; empty without any."""
    counted = [mark for mark in marks if not mark.undone]
    undone = sum(mark.undone for mark in marks)
    parts = []
    if arrived := [mark.name for mark in counted if not mark.stood]:
        parts.append(f"arrived at {', '.join(arrived)}")
    if stood := [mark for mark in counted if mark.stood]:
        parts.append("stood at " + ", ".join(f"{m.name} ({_length(m)})" for m in stood))
    if undone:
        parts.append(f"{undone} undone")
    return "; ".join(parts)


def _length(mark: Mark) -> str:
    return "not ended" if mark.to_s is None else f"{mark.to_s - mark.from_s:.1f} s"


def _standing(match: re.Match[str]) -> Mark:
    to_s = match["to_s"]
    return Mark(match["name"], float(match["from_s"]), float(to_s) if to_s else None, stood=True)
