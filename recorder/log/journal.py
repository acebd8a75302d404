"""What a log says about its frames while they go in: counts, and events for what is unusual."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from pathlib import Path

from recorder.errors import InputError
from recorder.image_header import image_fault, image_size
from recorder.log.counts import FrameCounts
from recorder.log.event_limit import EventLimiter
from recorder.log.frame_checks import FrameChecks
from recorder.sources.base import CapturedFrame

_TOLD = 100


class FrameJournal:
    """Judges the frames of one recording through all its parts; each part has its own counts.

    Attributes:
        announced: frames known to be lost that no count has yet.
        told: the warnings and errors that were written, the last hundred, for who takes them out.
    """

    def __init__(self, *, live: bool, calibrated_size: tuple[int, int] | None) -> None:
        """`live`: frames come once; `calibrated_size`: width and height, where they are known."""
        self._live = live
        self._size = calibrated_size
        self._sized_by = "the calibration" if calibrated_size else "the frames before"
        self._checks = FrameChecks(live=live)
        self._limiter = EventLimiter()
        self.announced = 0
        self.told: deque[str] = deque(maxlen=_TOLD)
        self.last_stamps = (0, 0)

    @property
    def passed_ns(self) -> int:
        """See `FrameChecks.passed_ns`."""
        return self._checks.passed_ns

    def check(self, frame: CapturedFrame, path: Path) -> str | None:
        """What is wrong with the image itself, in a few words; before anything is written.

        Raises:
            InputError: its size is not that of the others, and it can be had again: not live.
            ValueError: frame numbers that do not increase, or a time before 1970.
        """
        if not 0 <= frame.frame_index < 2**32 or min(frame.timestamp_ns, frame.arrival_ns) < 0:
            raise ValueError(
                f"expected a frame number of 32 bits and times since 1970, found "
                f"{frame.frame_index}, {frame.timestamp_ns}, {frame.arrival_ns}"
            )
        last_index = self._checks.last_index
        if last_index is not None and frame.frame_index <= last_index:
            raise ValueError(
                f"expected a frame number above {last_index}, found {frame.frame_index}"
            )
        if (fault := image_fault(frame.data, frame.format)) is not None:
            return fault
        size = image_size(frame.data)
        if size is None or self._size in (None, size):
            self._size = self._size or size
            return None
        expected, found = (f"{w}x{h}" for w, h in (self._size or size, size))
        if self._live:
            return f"of {found}, not {expected}"
        raise InputError(
            path,
            f"expected images of {expected} as {self._sized_by}, found {found}",
            f"frame {frame.frame_index}",
        )

    def judge(self, frame: CapturedFrame, fault: str | None, counts: FrameCounts) -> Iterator[str]:
        """Counts what is unusual about a frame before it is written; gives the texts for it."""
        index, arrival_ns = frame.frame_index, frame.arrival_ns
        verdict = self._checks.add(index, frame.timestamp_ns, arrival_ns)
        announced, self.announced = self.announced, 0
        self.last_stamps = (frame.timestamp_ns, arrival_ns)
        counts.dropped += max(verdict.gap, announced)
        if verdict.gap > announced:
            lost = f"{verdict.gap} frames lost" if verdict.gap > 1 else "1 frame lost"
            yield from self.admit(arrival_ns, f"{lost} before frame {index}")
        if verdict.late_ns:
            counts.late += 1
            late_s = verdict.late_ns / 1e9
            text = f"frame {index} is late: {late_s:.3f} s after the one before"
            yield from self.admit(arrival_ns, text)
        if verdict.back_ns:
            counts.stamped_back += 1
            back_s = verdict.back_ns / 1e9
            text = f"frame {index} is stamped {back_s:.6f} s before the one before"
            yield from self.admit(arrival_ns, text)
        if fault is not None:
            counts.corrupt += 1
            yield from self.admit(arrival_ns, f"frame {index} is {fault}")

    def announce(self, dropped: int) -> None:
        """Frames that are known to be lost, before a gap shows them or instead of one."""
        self.announced += dropped

    def admit(self, arrival_ns: int, text: str) -> Iterator[str]:
        """What to write of this: the text, unless there were too many of its kind just now."""
        admitted, before = self._limiter.admit(arrival_ns, text)
        for said in (before, text if admitted else None):
            if said is not None:
                self.told.append(said)
                yield said

    def end_part(self, counts: FrameCounts, *, goes_on: bool) -> Iterator[str]:
        """Counts what is open; gives what is still to be written.

        `goes_on`: in a next part, whose first frame's number says what was lost before it.
        """
        if not goes_on:
            counts.dropped += self.announced
            self.announced = 0
        yield from self._limiter.rest()
