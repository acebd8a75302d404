"""What a recording left in its log."""

from __future__ import annotations

from pathlib import Path

from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from tests.log_helpers import images


def end_of(path: Path) -> dict[str, str]:
    with LogReader(path) as log:
        return dict(log.metadata["session_end"])


def events_of(path: Path) -> list[LogEvent]:
    with LogReader(path) as log:
        return [r for r in log.records() if isinstance(r, LogEvent)]


def told_of(path: Path) -> list[LogEvent]:
    """Without late frames: this machine may be slow."""
    return [event for event in events_of(path) if " is late: " not in event.message]


def indices_of(path: Path) -> list[int]:
    with LogReader(path) as log:
        return [image.frame_index for image in images(log)]
