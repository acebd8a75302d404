"""What can be said of a frame as it goes by, from its number and its times."""

from __future__ import annotations

import statistics
from collections import deque
from dataclasses import dataclass

# A frame is late when nearly twice the usual time has passed since the one before it, and so much
# more at least. Nearly: a frame that a driver dropped without a word doubles the time.
_LATE_FACTOR = 1.75
_LATE_NS = 10_000_000
_INTERVALS_KEPT = 31
_INTERVALS_NEEDED = 8
# An interval that is so much shorter than usual, while frames are awaited since a pause, is of one
# that makes up for it.
_SHORT = 0.8


@dataclass(frozen=True)
class FrameVerdict:
    """What is unusual about one frame.

    Attributes:
        gap: frame numbers left out before it.
        late_ns: time since the frame before it, where that is too much; else 0.
        back_ns: how far its capture is before that of the frame before it; else 0.
    """

    gap: int
    late_ns: int
    back_ns: int


class FrameChecks:
    """Compares each frame with those before it.

    Late is said of frames that do not wait for us: those of a live source. The usual time between
    two arrivals is the median of the last 31, without those of frames that made up for a pause;
    frames lost in between are allowed for.

    Attributes:
        passed_ns: from the first capture to the last; where stamps jump back, no time passes.
    """

    def __init__(self, *, live: bool) -> None:
        self._live = live
        self._index: int | None = None
        self._timestamp_ns = 0
        self._arrival_ns = 0
        self._intervals_ns: deque[int] = deque(maxlen=_INTERVALS_KEPT)
        self._awaited_ns = 0.0
        self.passed_ns = 0

    @property
    def last_index(self) -> int | None:
        return self._index

    def add(self, frame_index: int, timestamp_ns: int, arrival_ns: int) -> FrameVerdict:
        """The verdict on the next frame."""
        if self._index is None:
            verdict = FrameVerdict(0, 0, 0)
        else:
            gap = max(frame_index - self._index - 1, 0)
            late_ns = self._late_ns(arrival_ns - self._arrival_ns, gap) if self._live else 0
            verdict = FrameVerdict(gap, late_ns, max(self._timestamp_ns - timestamp_ns, 0))
            self.passed_ns += max(timestamp_ns - self._timestamp_ns, 0)
        self._index, self._timestamp_ns, self._arrival_ns = frame_index, timestamp_ns, arrival_ns
        return verdict

    def _late_ns(self, passed_ns: int, gap: int) -> int:
        known = len(self._intervals_ns) >= _INTERVALS_NEEDED
        usual_ns = statistics.median(self._intervals_ns) if known else 0.0
        # A clock that was set, back or forth, says nothing about what is usual.
        if passed_ns >= 0 and not gap and not self._makes_up(passed_ns, usual_ns):
            self._intervals_ns.append(passed_ns)
        limit_ns = max((_LATE_FACTOR + gap) * usual_ns, (1 + gap) * usual_ns + _LATE_NS)
        return passed_ns if known and passed_ns > limit_ns else 0

    def _makes_up(self, passed_ns: int, usual_ns: float) -> bool:
        """Whether an interval is of a frame that waited; keeps account of how long is made up."""
        made_up = self._awaited_ns > usual_ns / 2 and passed_ns < _SHORT * usual_ns
        if not made_up and passed_ns < _LATE_FACTOR * usual_ns:
            # Frames that were lost are not made up for: what is as usual makes them forgotten.
            self._awaited_ns /= 2
        self._awaited_ns = max(self._awaited_ns + passed_ns - usual_ns, 0.0) if usual_ns else 0.0
        return made_up
