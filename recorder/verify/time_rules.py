"""Rules on the frames' times."""

from __future__ import annotations

import numpy as np

from recorder.info_text import counted
from recorder.verify.facts import Facts
from recorder.verify.verdict import Verdict, failed, ok, warning

# An interval is regular within half of the usual one; so many of a hundred may be otherwise.
_REGULAR = 0.5
_IRREGULAR_PERCENT = 1.0
# A pause is as long as so many intervals.
_PAUSE = 5.0
_CLOCKS_S = 1.0


def stamps(facts: Facts) -> Verdict:
    """Captures go on in time."""
    steps = np.diff(facts.timestamps_ns)
    back = np.flatnonzero(steps < 0)
    if len(back):
        frame, by_s = int(facts.indices[back[0] + 1]), float(-steps[back[0]]) / 1e9
        times = "once" if len(back) == 1 else f"{len(back)} times"
        return failed("stamps", f"they jump back {times}, first at frame {frame} by {by_s:.6f} s")
    if len(still := np.flatnonzero(steps == 0)):
        frame = int(facts.indices[still[0] + 1])
        return warning("stamps", f"{len(still)} frames at the time of another, first {frame}")
    return ok("stamps", "each is later than the one before")


def rate(facts: Facts) -> Verdict:
    """Frames come regularly."""
    numbers, times_ns = facts.indices, facts.timestamps_ns
    steps_ns = np.diff(times_ns)[np.diff(numbers) == 1]
    usual_ns = float(np.median(steps_ns)) if len(steps_ns) else 0.0
    if usual_ns <= 0:
        return ok("rate", "too few frames to tell")
    odd = np.abs(steps_ns - usual_ns) > _REGULAR * usual_ns
    percent = 100 * float(odd.mean())
    hz = f"{1e9 / usual_ns:.2f} frames/s"
    longest_s = float(steps_ns.max()) / 1e9
    if longest_s * 1e9 > _PAUSE * usual_ns:
        before = int(np.argmax(np.where(np.diff(numbers) == 1, np.diff(times_ns), 0)))
        frame = int(numbers[before])
        return warning("rate", f"{hz}, but a pause of {longest_s:.3f} s after frame {frame}")
    if percent > _IRREGULAR_PERCENT:
        return warning(
            "rate",
            f"{hz}, but {percent:.1f} % of the intervals are off by half of one or more; "
            f"the longest is {longest_s:.3f} s",
        )
    return ok("rate", f"{hz}, {percent:.1f} % of the intervals off by half of one or more")


def arrivals(facts: Facts) -> Verdict:
    """Frames arrive after they were captured, by one and the same clock, and none is late."""
    if not facts.live:
        return ok("arrivals", "not a live recording")
    behind_s = (facts.arrivals_ns - facts.timestamps_ns) / 1e9
    if len(behind_s) and abs(apart_s := float(np.median(behind_s))) > _CLOCKS_S:
        text = f"capture and arrival are {apart_s:.3f} s apart: of two clocks?"
        return warning("arrivals", text)
    if late := facts.said("frames_late"):
        return warning("arrivals", f"{counted(late, 'frame')} late")
    usual = f"{1000 * float(np.median(behind_s)):.1f} ms after capture" if len(behind_s) else "none"
    return ok("arrivals", f"usually {usual}")
