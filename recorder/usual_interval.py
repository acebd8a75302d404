"""The usual interval of frames, also where many of them came in bursts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# With fewer intervals there is no usual one.
NEEDED = 8
# An interval is regular within half of the usual one.
REGULAR = 0.5
# So many regular frames are settled: what is late by then does not come any more.
SETTLED = 5
# A camera that goes so much faster is no regular one.
_AS_USUAL = 0.2
# Frames that waited come behind a pause, and all but a few of them at once. Where no frame came at
# its own time, but every so often many together, their mean is the usual one: of others only a
# recording that lost four fifths of its frames looks like that.
_SHORT = 0.5
_AT_ONCE = 0.2
_EXPLAINED = 0.9
_QUANTILES = np.linspace(0.5, 0.99, 25)


def usual_interval_ns(
    steps_ns: NDArray[np.float64], numbers: NDArray[np.int64], adjoin: NDArray[np.bool_]
) -> float | None:
    """From one frame number to the next: the median, without intervals that are off.

    Where most intervals are of frames that made up for a pause, that of the others: it is told by
    the pauses, which are as long as what follows them is short.

    Args:
        steps_ns: (N,) between one frame and the next; those not above 0 are no intervals.
        numbers: (N,) by how much the frame number increases, at least 1.
        adjoin: (N,) False where a part is missing.

    Returns:
        None with too few intervals.
    """
    known = adjoin & (steps_ns > 0)
    if np.count_nonzero(known) < NEEDED:
        return None
    each_ns = (steps_ns / numbers)[known]
    # One of them, not the mean of two.
    median_ns, *longer = np.quantile(each_ns, _QUANTILES, method="higher").tolist()
    usual_ns = median_ns = _refined(each_ns, median_ns)
    most = 0
    # One between two kinds is not the usual one.
    alone = np.count_nonzero(_regular(each_ns, median_ns)) < NEEDED
    there = adjoin & (steps_ns >= 0)
    for longer_ns in (_refined(each_ns, each) for each in longer):
        if longer_ns * _SHORT <= median_ns and not alone:
            continue
        regular = int(np.count_nonzero(_regular(each_ns, longer_ns)))
        more = regular > max(most, NEEDED - 1)
        if more and _explained(steps_ns, numbers, there, longer_ns, _SHORT):
            usual_ns, most = longer_ns, regular
    if usual_ns != median_ns:
        return usual_ns
    mean_ns = float(steps_ns[there].sum() / numbers[there].sum())
    pauses = np.count_nonzero(each_ns > mean_ns / _SHORT)
    if (
        median_ns < _AT_ONCE * mean_ns
        and pauses >= NEEDED
        and _explained(steps_ns, numbers, there, mean_ns, _AT_ONCE)
    ):
        return mean_ns
    return median_ns


def waiting(late: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether frames were still to come since a pause, at the start of each interval.

    Args:
        late: (N,) by how many frames each interval is longer than usual.
    """
    waits, behind, settled = [], 0.0, 0
    for by in late.tolist():
        waits.append(behind > REGULAR)
        settled = settled + 1 if -_AS_USUAL <= by <= REGULAR else 0
        behind = max(behind + by, 0.0) if settled < SETTLED else 0.0
    return np.array(waits, dtype=bool)


def _explained(
    steps_ns: NDArray[np.float64],
    numbers: NDArray[np.int64],
    there: NDArray[np.bool_],
    usual_ns: float,
    short: float,
) -> bool:
    """Whether what is shorter than this makes up for a pause before it."""
    fast = there & (steps_ns < short * usual_ns * numbers)
    late = np.where(there, steps_ns / usual_ns - numbers, 0.0)
    made_up = fast & waiting(late)
    return int(np.count_nonzero(made_up)) >= _EXPLAINED * max(int(np.count_nonzero(fast)), 1)


def _regular(each_ns: NDArray[np.float64], usual_ns: float) -> NDArray[np.bool_]:
    regular: NDArray[np.bool_] = np.abs(each_ns - usual_ns) <= REGULAR * usual_ns
    return regular


def _refined(each_ns: NDArray[np.float64], usual_ns: float) -> float:
    """Those that lack frames make it too long."""
    regular = _regular(each_ns, usual_ns)
    return float(np.median(each_ns[regular])) if regular.any() else usual_ns
