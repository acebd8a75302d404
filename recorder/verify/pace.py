"""How frames follow one another in time, and what is missing between them by it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, median_filter, uniform_filter1d

from recorder.usual_interval import (
    REGULAR,
    SETTLED,
    never_made_up,
    usual_interval_ns,
    waiting,
)

# In the dark a camera exposes for longer, and halves its rate: for a while that is no loss. A while
# is as long as so many intervals, its rate their median, and another one from a quarter on. Most
# of them have that rate; else some come in bursts.
_WHILE = 31
_OTHER = 1.25
_HALVED = 2.25
_MOST = 0.7


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
        lost: (N - 1,) frames that did not come, beyond those that the frame numbers lack.
    """

    usual_ns: float
    expected_ns: NDArray[np.float64]
    passed: NDArray[np.float64]
    off: NDArray[np.bool_]
    there: NDArray[np.bool_]
    lost: NDArray[np.int64]

    @property
    def lossy(self) -> NDArray[np.bool_]:
        """(N - 1,) intervals that lack frames."""
        lossy: NDArray[np.bool_] = self.lost > 0
        return lossy

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
    as_there = (np.abs(each_ns - local_ns) <= REGULAR * local_ns).astype(np.float64)
    steady = uniform_filter1d(as_there, _WHILE, mode="nearest") > _MOST
    changed = binary_opening((ratio > _OTHER) & (ratio < _HALVED) & steady, np.ones(_WHILE))
    slower = changed & (local_ns > usual_ns)
    waited = waiting(np.where(adjoin & ~slower, steps_ns / usual_ns - numbers, 0.0))
    # Frames that waited come at another rate than the camera's.
    catching_up = changed & ~slower & waited
    changed &= ~catching_up
    expected_ns = np.where(changed, local_ns, usual_ns)
    passed = steps_ns / expected_ns
    late = np.where(adjoin, passed - numbers, 0.0)
    off = np.abs(late) > REGULAR
    lost = _lost(late, off | catching_up)
    return Pace(usual_ns, expected_ns, passed, off, adjoin, lost)


def _lost(late: NDArray[np.float64], irregular: NDArray[np.bool_]) -> NDArray[np.int64]:
    """By how many frames all others are later, in and behind each irregular stretch.

    What comes too early without a stamp that jumps back had waited since a stretch before: it is
    not lost there.
    """
    lost = np.zeros(len(late), np.int64)
    places = np.flatnonzero(irregular)
    if not len(places):
        return lost
    breaks = np.flatnonzero(np.diff(places) > SETTLED)
    firsts = places[np.concatenate([[0], breaks + 1])]
    lasts = places[np.concatenate([breaks, [len(places) - 1]])]
    lateness = np.concatenate([[0.0], np.cumsum(late)])
    # Each of them may be a little off.
    around = np.arange(SETTLED)
    before = np.median(lateness[np.maximum(firsts[:, None] - around, 0)], axis=1)
    behind = np.median(lateness[np.minimum(lasts[:, None] + 1 + around, len(late))], axis=1)
    holes: list[int] = []
    longest = 0.0
    for first, last, start, end in zip(firsts, lasts, before, behind, strict=True):
        inside = slice(first, last + 1)
        stretch = np.concatenate([[start], lateness[first + 1 : last + 1], [end]])
        if last + SETTLED >= len(late):
            stretch = _without_cut_off(stretch, longest)
        stays = never_made_up(stretch)
        longest = max(longest, float((stretch - stays).max()))
        # The first frames of all may be late themselves.
        base = stays[0] if first < SETTLED and stays[0] < start - REGULAR else start
        lost[inside] = np.diff(np.rint(np.maximum(stays - base, 0.0))).astype(np.int64)
        holes += (first + np.flatnonzero(lost[inside])).tolist()
        early = round(float(start - end)) if (late[inside] >= -1).all() else 0
        while early > 0 and holes:
            found = min(early, int(lost[holes[-1]]))
            lost[holes[-1]] -= found
            early -= found
            if not lost[holes[-1]]:
                holes.pop()
    return lost


def _without_cut_off(lateness: NDArray[np.float64], longest: float) -> NDArray[np.float64]:
    """As before the last pause, if the log ended before its frames had all come.

    They were still coming in a burst, less late than any since; or hardly any had come, and others
    made up for as long.
    """
    end = len(lateness)
    while True:
        stays = never_made_up(lateness[:end])
        pauses = np.flatnonzero(np.diff(stays) > REGULAR / 2)
        if not len(pauses):
            break
        at = int(pauses[-1])
        came = np.diff(lateness[at + 1 : end])
        if len(came) < SETTLED:
            made_up = max(longest, float((lateness[:end] - stays)[: at + 1].max()))
            coming = float(lateness[at + 1] - lateness[at]) - REGULAR <= made_up > REGULAR
        else:
            least = float(lateness[at + 1 : end - SETTLED].min())
            coming = bool(np.median(came[-SETTLED:]) < -REGULAR and lateness[end - 1] < least - 1)
        if not coming:
            break
        end = at + 1
    return np.where(np.arange(len(lateness)) < end, lateness, lateness[end - 1])
