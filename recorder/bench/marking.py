"""What the operator marks, and the events that come of it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from recorder.bench.clock import CaptureClock
from recorder.bench.marks import Mark, log_seconds
from recorder.capture.notes import Notes

_NO_IMAGE = "no image has come yet: nothing to mark"


@dataclass
class _Progress:
    """Where the operator is.

    Attributes:
        at: the waypoint that was reached last.
        standing: the mark that has no end yet.
        done: the marks that count, each with the waypoint before it.
    """

    at: str | None = None
    standing: Mark | None = None
    done: list[tuple[Mark, str | None]] = field(default_factory=list)


class Marking:
    """Writes marks into `notes`, with the capture time of the moment at which a key came.

    Each method says in a line what it did, or why it did nothing; from any thread.
    """

    def __init__(self, notes: Notes, clock: CaptureClock, names: Sequence[str] = ()) -> None:
        """`names`: of the waypoints in truth.yaml, in their order; none where they are counted."""
        self._notes = notes
        self._clock = clock
        self._names = tuple(names)
        self._progress = _Progress()
        self._lock = threading.RLock()

    def status(self, system_ns: int) -> str:
        """Where the camera is, and the last mark."""
        with self._lock:
            progress = self._progress
            if progress.standing is not None:
                now_s = self._now_s(system_ns) or progress.standing.from_s
                lasts_s = max(now_s - progress.standing.from_s, 0.0)
                return f"standing still at {progress.standing.name} for {lasts_s:.1f} s (s ends it)"
            where = "no waypoint yet" if progress.at is None else f"at {progress.at}"
            if not progress.done:
                return where
            mark, _ = progress.done[-1]
            return f"{where}, last mark {self._said(mark)} ({len(progress.done)} in all)"

    def arrived(self, typed: str, system_ns: int) -> str:
        """At the waypoint of this name."""
        with self._lock:
            now_s = self._now_s(system_ns)
            if now_s is None:
                return _NO_IMAGE
            name = self._spelling(typed)
            standing = self._progress.standing
            if standing is not None and standing.name == name:
                return f"stands still at {name} already; s ends it"
            left = self._leave()
            mark = Mark(name, now_s, now_s, stood=False)
            self._add(mark, system_ns)
            self._progress.at = name
            unknown = bool(self._names) and name not in self._names
            return f"{self._said(mark)}{' (not in truth.yaml)' if unknown else ''}{left}"

    def step(self, by: int, system_ns: int) -> str:
        """At the waypoint `by` places after the last one; from the last to the first again."""
        with self._lock:
            name = self._neighbour(by)
            return "no waypoint before this one" if name is None else self.arrived(name, system_ns)

    def toggle_standing(self, system_ns: int) -> str:
        """Begin to stand still at this waypoint, or end it."""
        with self._lock:
            progress = self._progress
            now_s = self._now_s(system_ns)
            if now_s is None:
                return _NO_IMAGE
            if progress.standing is not None:
                return self._end_standing(now_s, system_ns)
            if progress.at is None:
                return "which waypoint? type its number and Enter, or n, then s"
            mark = Mark(progress.at, now_s, None, stood=True)
            self._add(mark, system_ns)
            progress.standing = mark
            return self._said(mark)

    def undo(self, system_ns: int) -> str:
        """Take the last mark back; the log keeps both."""
        with self._lock:
            progress = self._progress
            if not progress.done:
                return "nothing to undo"
            mark, progress.at = progress.done.pop()
            if mark.stood:
                progress.standing = None
            self._write(mark.undone_text(), system_ns)
            return mark.undone_text()

    def note(self, text: str, system_ns: int) -> str:
        """In the operator's own words."""
        self._write(f"note: {text}", system_ns)
        return f"note: {text}"

    def end(self) -> None:
        """No more frames: who stands still does so until the last one."""
        with self._lock:
            standing, last_ns = self._progress.standing, self._clock.last_ns
            if standing is None or last_ns is None or self._clock.start_ns is None:
                return
            last_s = log_seconds(last_ns, self._clock.start_ns)
            if last_s > standing.from_s:
                mark = replace(standing, to_s=last_s)
                self._notes.add(mark.text(), timestamp_ns=last_ns)
            self._progress.standing = None

    def _end_standing(self, now_s: float, system_ns: int) -> str:
        standing, before = self._progress.done[-1]
        self._progress.standing = None
        if now_s <= standing.from_s:
            return self.undo(system_ns)
        mark = replace(standing, to_s=now_s)
        self._progress.done[-1] = (mark, before)
        self._write(mark.text(), system_ns)
        return self._said(mark)

    def _leave(self) -> str:
        """Nobody knows when the camera moved on that now is elsewhere."""
        if self._progress.standing is None:
            return ""
        mark, _ = self._progress.done.pop()
        self._progress.standing = None
        self._notes.add(mark.undone_text(), level="warning")
        return f"; {mark.text()} was not ended with s: undone"

    def _add(self, mark: Mark, system_ns: int) -> None:
        self._progress.done.append((mark, self._progress.at))
        self._write(mark.text(), system_ns)

    def _write(self, text: str, system_ns: int) -> None:
        self._notes.add(text, timestamp_ns=self._clock.capture_ns(system_ns))

    def _now_s(self, system_ns: int) -> float | None:
        start_ns = self._clock.start_ns
        if start_ns is None:
            return None
        # What comes while the first image is on its way is marked at it.
        return max(log_seconds(self._clock.capture_ns(system_ns), start_ns), 0.0)

    def _spelling(self, typed: str) -> str:
        """As in truth.yaml, where only the case differs."""
        return next((n for n in self._names if n.casefold() == typed.casefold()), typed)

    def _neighbour(self, by: int) -> str | None:
        at, names = self._progress.at, self._names
        if names:
            if at in names:
                return names[(names.index(at) + by) % len(names)]
            return names[0] if by > 0 else names[-1]
        if at is None:
            return "1" if by > 0 else None
        if not at.isdecimal():
            return None
        return str(int(at) + by) if int(at) + by >= 0 else None

    def _said(self, mark: Mark) -> str:
        """A mark with its time, for people."""
        return mark.text() if mark.stood else f"{mark.text()} at {mark.from_s:.3f}"
