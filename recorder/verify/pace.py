"""How frames follow one another in time, and what is missing between them by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, median_filter

from recorder.usual_interval import REGULAR, SETTLED, usual_interval_ns, waiting

# In the dark a camera exposes for longer, and halves its rate: for a while that is no loss. A while
# is as long as so many intervals, its rate their median, and another one from a quarter on.
_WHILE = 31
_OTHER = 1.25
_HALVED = 2.25


@dataclass(frozen=True, eq=False)
class Pace:
    """The N - 1 intervals between N frames; across parts that are missing there is none.

    Attributes:
        usual_ns: from one frame number to the next: see `recorder.usual_interval`.
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
    usual_ns = usual_interval_ns(steps_ns, numbers, adjoin)
    if usual_ns is None:
        return None
    known = adjoin & (steps_ns > 0)
    each_ns = steps_ns / numbers
    local_ns = median_filter(np.where(known, each_ns, usual_ns), _WHILE, mode="nearest")
    ratio = np.maximum(local_ns / usual_ns, usual_ns / local_ns)
    changed = binary_opening((ratio > _OTHER) & (ratio < _HALVED), np.ones(_WHILE))
    slower = changed & (local_ns > usual_ns)
    waited = waiting(np.where(adjoin & ~slower, steps_ns / usual_ns - numbers, 0.0))
    # Frames that waited come at another rate than the camera's.
    catching_up = changed & ~slower & waited
    changed &= ~catching_up
    expected_ns = np.where(changed, local_ns, usual_ns)
    passed = steps_ns / expected_ns
    late = np.where(adjoin, passed - numbers, 0.0)
    off = np.abs(late) > REGULAR
    lost, lossy = _lost(late, off | catching_up)
    return Pace(usual_ns, expected_ns, passed, off, adjoin, lost, lossy)


def _lost(
    late: NDArray[np.float64], irregular: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """By how many frames the others are later behind each irregular stretch than before it.

    What comes too early without a stamp that jumps back had waited since a stretch before: it is
    not lost there.
    """
    lost, lossy = np.zeros(len(late), np.int64), np.zeros(len(late), bool)
    places = np.flatnonzero(irregular)
    if not len(places):
        return lost, lossy
    breaks = np.flatnonzero(np.diff(places) > SETTLED)
    firsts = places[np.concatenate([[0], breaks + 1])]
    lasts = places[np.concatenate([breaks, [len(places) - 1]])]
    lateness = np.concatenate([[0.0], np.cumsum(late)])
    # Each of them may be a little off.
    around = np.arange(SETTLED)
    before = np.median(lateness[np.maximum(firsts[:, None] - around, 0)], axis=1)
    behind = np.minimum(lasts[:, None] + 1 + around, len(late))
    later = np.rint(np.median(lateness[behind], axis=1) - before).astype(np.int64)
    holes: list[int] = []
    for first, last, frames in zip(firsts, lasts, later, strict=True):
        if frames > 0:
            holes.append(first + int(np.argmax(late[first : last + 1])))
            lost[holes[-1]] = frames
            lossy[first : last + 1] = True
        early = -int(frames) if (late[first : last + 1] >= -1).all() else 0
        while early > 0 and holes:
            found = min(early, int(lost[holes[-1]]))
            lost[holes[-1]] -= found
            early -= found
            if not lost[holes[-1]]:
                lossy[holes.pop()] = False
    return lost, lossy
