"""What can be said of a frame as it goes by, from its numbers, times and first and last bytes."""

from __future__ import annotations

import statistics
from collections import deque
from dataclasses import dataclass

from recorder.image_header import is_cut, read_header

# A frame is late when nearly twice the usual time has passed since the one before it, and so much
# more at least. Nearly: a frame that a driver dropped without a word doubles the time.
_LATE_FACTOR = 1.75
_LATE_NS = 10_000_000
_INTERVALS_KEPT = 31
_INTERVALS_NEEDED = 8
_MANY_KEPT = 300


def image_fault(data: bytes, format: str) -> str | None:
    """Why compressed bytes are no whole image, in a few words; None where nothing shows.

    Only the header and the end are looked at.
    """
    if not data:
        return "empty"
    header = read_header(data)
    if header is None or header.format != format:
        return f"not a readable {format} image"
    if is_cut(data, format):
        return f"a {format} image without its end"
    return None


def image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of compressed bytes, where their header says them."""
    header = read_header(data)
    return None if header is None else (header.width_px, header.height_px)


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
    two arrivals is the median of the last 31 or, if it is longer (a burst made up for a pause), of
    the last 300; frames lost in between are allowed for.

    Attributes:
        passed_ns: from the first capture to the last; where stamps jump back, no time passes.
    """

    def __init__(self, *, live: bool) -> None:
        self._live = live
        self._index: int | None = None
        self._timestamp_ns = 0
        self._arrival_ns = 0
        self._intervals_ns: deque[int] = deque(maxlen=_INTERVALS_KEPT)
        self._many_ns: deque[int] = deque(maxlen=_MANY_KEPT)
        self._long_ns = 0.0
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
        usual_ns = max(statistics.median(self._intervals_ns), self._long_ns) if known else 0.0
        # A clock that was set, back or forth, says nothing about what is usual.
        if passed_ns >= 0 and not gap:
            self._intervals_ns.append(passed_ns)
            self._many_ns.append(passed_ns)
            if len(self._many_ns) % _INTERVALS_KEPT == 0 or len(self._many_ns) == _MANY_KEPT:
                self._long_ns = statistics.median(self._many_ns)
        limit_ns = max((_LATE_FACTOR + gap) * usual_ns, (1 + gap) * usual_ns + _LATE_NS)
        return passed_ns if known and passed_ns > limit_ns else 0
