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
# A smaller share of regular intervals among regular ones tells nothing of the rate.
_TOLD = 0.1
_ROUNDS = 3
# Candidates that are closer come to the same.
_SAME = 1e-4
# Against a camera this much faster, frames at their own time are later than all before.
_FASTER = 0.02
# Where nothing is lost the mean is the usual one: it corrects a candidate by no more than that.
_CORRECTION = 0.1
# What is late for ever by so much lost a frame; the rest is what the candidate is off by.
_LOST = 0.75
# A frame can be late, but hardly early. That is as odd as so many odd intervals.
_EARLY = 4.0


def usual_interval_ns(
    steps_ns: NDArray[np.float64], numbers: NDArray[np.int64], adjoin: NDArray[np.bool_]
) -> float | None:
    """From one frame number to the next, by the steady camera that explains the times best.

    Its frames may come late, then several at once; each may be a little off its time; and some are
    lost. Candidates are the medians over one interval, two, four and so on up to all: bursts do
    not reach over the longer ones, and losses not into the shorter ones. The best is that with the
    fewest odd intervals, frames lost and frames early: see `_oddness`.

    What looks alike cannot be told: a camera of which every second frame is lost from start to end
    is one of half the rate; one that gives a few frames quickly and then rests, over and over, is
    one whose frames come in bursts, as far as it would have lost more than half of them.

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
    there = adjoin & (steps_ns >= 0)
    steps_ns, numbers = steps_ns[there], numbers[there]
    found: list[tuple[float, float]] = []
    tried: list[float] = []
    for rough_ns in _medians(steps_ns, numbers):
        if any(abs(rough_ns - other_ns) <= _SAME * other_ns for other_ns in tried):
            continue
        refined_ns = _refined(each_ns, rough_ns)
        tried += [rough_ns, refined_ns]
        found.append((_oddness(steps_ns, numbers, refined_ns), refined_ns))
        mean_ns = _mean_if_all_came(steps_ns, numbers, refined_ns) or _mean_if_all_came(
            steps_ns, numbers, _between_on_time(steps_ns, numbers, refined_ns)
        )
        if mean_ns and abs(mean_ns - refined_ns) <= _CORRECTION * refined_ns:
            found.append((_oddness(steps_ns, numbers, mean_ns), mean_ns))
    return min(found)[1]


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


def never_made_up(lateness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each frame's lateness, what no later frame is free of."""
    return np.minimum.accumulate(lateness[::-1])[::-1]


def _oddness(steps_ns: NDArray[np.float64], numbers: NDArray[np.int64], usual_ns: float) -> float:
    """How odd the times are for this interval, in odd intervals."""
    late = steps_ns / usual_ns - numbers
    lateness = np.concatenate([[0.0], np.cumsum(late)])
    odd = float(np.minimum(np.abs(late) / REGULAR, 1.0).sum())
    lost = np.diff(never_made_up(lateness))
    # One outage may have lost most of the frames: it alone makes no burst of the others.
    odd += float(np.minimum(lost, len(late) / NEEDED).sum())
    return odd - _EARLY * float(lateness.min())


def _between_on_time(
    steps_ns: NDArray[np.float64], numbers: NDArray[np.int64], usual_ns: float
) -> float:
    """The median from one frame that is not late to the next such, by the frames in between."""
    late = steps_ns / (usual_ns * (1.0 - _FASTER)) - numbers
    lateness = np.concatenate([[0.0], np.cumsum(late)])
    on_time = np.flatnonzero(lateness <= never_made_up(lateness))
    times_ns = np.concatenate([[0.0], np.cumsum(steps_ns)])[on_time]
    ticks = np.diff(np.concatenate([[0], np.cumsum(numbers)])[on_time])
    if not len(ticks):
        return usual_ns
    each_ns = np.diff(times_ns) / ticks
    order = np.argsort(each_ns)
    below = np.cumsum(ticks[order])
    return float(each_ns[order][np.searchsorted(below, below[-1] / 2)])


def _mean_if_all_came(
    steps_ns: NDArray[np.float64], numbers: NDArray[np.int64], usual_ns: float
) -> float | None:
    """From one frame that was not late to another, as far apart as they are."""
    lateness = np.concatenate([[0.0], np.cumsum(steps_ns / usual_ns - numbers)])
    part = len(lateness) // 4
    first = int(np.argmin(lateness[:part]))
    last = len(lateness) - 1 - int(np.argmin(lateness[: -part - 1 : -1]))
    if (np.diff(never_made_up(lateness[first : last + 1])) >= _LOST).any():
        return None
    return float(steps_ns[first:last].sum()) / float(numbers[first:last].sum())


def _medians(steps_ns: NDArray[np.float64], numbers: NDArray[np.int64]) -> list[float]:
    """Of one interval, two, four and so on; and the mean of all."""
    times_ns = np.concatenate([[0.0], np.cumsum(steps_ns)])
    ticks = np.concatenate([[0], np.cumsum(numbers)])
    widths = [2**i for i in range(len(steps_ns).bit_length())] + [len(steps_ns)]
    each_ns = ((times_ns[n:] - times_ns[:-n]) / (ticks[n:] - ticks[:-n]) for n in widths)
    # One of them, not the mean of two.
    medians = (float(np.partition(each, len(each) // 2)[len(each) // 2]) for each in each_ns)
    return [median_ns for median_ns in medians if median_ns > 0]


def _refined(each_ns: NDArray[np.float64], usual_ns: float) -> float:
    """The median of regular intervals among regular ones, if there are any.

    One behind a burst is too short by what the burst was late; those that lack frames are too long.
    """
    for _ in range(_ROUNDS):
        regular = np.abs(each_ns - usual_ns) <= REGULAR * usual_ns
        around = np.concatenate([[True], regular, [True]])
        regular &= around[:-2] & around[2:]
        if np.count_nonzero(regular) < _TOLD * len(each_ns):
            break
        usual_ns = float(np.median(each_ns[regular]))
    return usual_ns
