"""How frames follow one another in time, and what is missing between them by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, median_filter

# With fewer intervals there is no usual one.
_NEEDED = 8
# An interval is regular within half of the usual one.
_REGULAR = 0.5
# So many regular frames are settled: what is late by then does not come any more. It is also how
# many the time before and after is taken from, as each of them may be a little off.
_SETTLED = 5
# In the dark a camera exposes for longer, and halves its rate: for a while that is no loss. A while
# is as long as so many intervals, its rate their median, and another one from a quarter on.
_WHILE = 31
_OTHER = 1.25
_HALVED = 2.25


@dataclass(frozen=True, eq=False)
class Pace:
    """The N - 1 intervals between N frames; across parts that are missing there is none.

    Attributes:
        usual_ns: from one frame number to the next: the median, without those that are off.
        expected_ns: (N - 1,) the same at each place: another one where the camera is slower or
            faster for a while.
        passed: (N - 1,) how many expected intervals passed: two where one frame is missing.
        off: (N - 1,) further than half an interval from what the frame numbers say.
        there: (N - 1,) whether there is one.
        lost: (N - 1,) frames that did not come, beyond those that the frame numbers lack; told at
            the longest of the intervals that lack them.
        lossy: (N - 1,) intervals that lack them.
    """

    usual_ns: float
    expected_ns: NDArray[np.float64]
    passed: NDArray[np.float64]
    off: NDArray[np.bool_]
    there: NDArray[np.bool_]
    lost: NDArray[np.int64]
    lossy: NDArray[np.bool_]

    @property
    def changed(self) -> NDArray[np.bool_]:
        """(N - 1,) where the camera goes at another rate."""
        other: NDArray[np.bool_] = self.expected_ns != self.usual_ns
        return self.there & other


def pace_of(
    indices: NDArray[np.int64], timestamps_ns: NDArray[np.int64], adjoin: NDArray[np.bool_]
) -> Pace | None:
    """None where there are too few frames to tell.

    A pause whose frames come in a burst behind it lacks none: their times alone are wrong.

    Args:
        adjoin: (N - 1,) False where a part is missing between two frames.
    """
    numbers = np.maximum(np.diff(indices), 1)
    steps_ns = np.diff(timestamps_ns).astype(np.float64)
    known = adjoin & (steps_ns > 0)
    if np.count_nonzero(known) < _NEEDED:
        return None
    each_ns = steps_ns / numbers
    usual_ns = float(np.median(each_ns[known]))
    # Those that lack frames make it too long.
    regular = known & (np.abs(each_ns - usual_ns) <= _REGULAR * usual_ns)
    if regular.any():
        usual_ns = float(np.median(each_ns[regular]))
    local_ns = median_filter(np.where(known, each_ns, usual_ns), _WHILE, mode="nearest")
    ratio = np.maximum(local_ns / usual_ns, usual_ns / local_ns)
    changed = binary_opening((ratio > _OTHER) & (ratio < _HALVED), np.ones(_WHILE))
    expected_ns = np.where(changed, local_ns, usual_ns)
    passed = steps_ns / expected_ns
    late = np.where(adjoin, passed - numbers, 0.0)
    off = np.abs(late) > _REGULAR
    lost, lossy = _lost(late, off)
    return Pace(usual_ns, expected_ns, passed, off, adjoin, lost, lossy)


def _lost(
    late: NDArray[np.float64], off: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """By how many frames the others are later behind each irregular stretch than before it."""
    lost, lossy = np.zeros(len(late), np.int64), np.zeros(len(late), bool)
    places = np.flatnonzero(off)
    if not len(places):
        return lost, lossy
    breaks = np.flatnonzero(np.diff(places) > _SETTLED)
    firsts = places[np.concatenate([[0], breaks + 1])]
    lasts = places[np.concatenate([breaks, [len(places) - 1]])]
    lateness = np.concatenate([[0.0], np.cumsum(late)])
    around = np.arange(_SETTLED)
    before = np.median(lateness[np.maximum(firsts[:, None] - around, 0)], axis=1)
    behind = np.minimum(lasts[:, None] + 1 + around, len(late))
    later = np.rint(np.median(lateness[behind], axis=1) - before).astype(np.int64)
    for first, last, frames in zip(firsts, lasts, later, strict=True):
        if frames > 0:
            lost[first + int(np.argmax(late[first : last + 1]))] = frames
            lossy[first : last + 1] = True
    return lost, lossy
