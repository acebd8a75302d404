"""Rules on the frames' numbers and times."""

from __future__ import annotations

import numpy as np

from recorder.info_text import counted
from recorder.verify.facts import Facts
from recorder.verify.limits import IRREGULAR_NOTED_PERCENT, IRREGULAR_PERCENT, LOST_PERCENT
from recorder.verify.verdict import Verdict, failed, ok, warning

# A pause is as long as so many intervals.
_PAUSE = 5.0
# Of the irregular intervals: with more lost frames it is these that make them.
_FEW_LOST = 0.1
# Less of the rate that a camera was set to.
_SLOWER = 0.9
_CLOCKS_S = 1.0
# A capture cannot be later than its arrival, but for what two readings of clocks differ by.
_AHEAD_S = 0.005


def gaps(facts: Facts) -> Verdict:
    """Few frames were lost: by their numbers, and in pauses that have none."""
    steps = np.diff(facts.indices)
    if (steps <= 0).any():
        after = int(facts.indices[np.flatnonzero(steps <= 0)[0]])
        return failed("gaps", f"frame numbers do not increase after frame {after}")
    pace = facts.pace
    missing = np.where(facts.adjoin, steps - 1, 0)
    numbered = int(missing.sum())
    told = max((facts.said("frames_dropped") or 0) - numbered, 0)
    paused = int(pace.lost.sum()) if pace is not None else 0
    lost = numbered + told + paused
    percent = 100 * lost / max(lost + len(facts.indices), 1)
    seconds = lost * pace.usual_ns / 1e9 if pace is not None else None
    values = {"frames_lost": lost, "percent_lost": percent, "frames_lost_in_pauses": paused}
    if seconds is not None:
        values["seconds_lost"] = seconds
    if not lost:
        return ok("gaps", "no frame is missing", **values)
    kinds = ((numbered, "by number"), (paused, "in pauses"), (told, "counted by the recorder"))
    text = f"{counted(lost, 'frame')} lost, {percent:.3g} % (limit {LOST_PERCENT:g} %)"
    text += "" if seconds is None else f", {seconds:.3f} s"
    text += ": " + ", ".join(f"{number} {kind}" for number, kind in kinds if number)
    holes = missing + (pace.lost if pace is not None else 0)
    if holes.any():
        longest = int(np.argmax(holes))
        pause_s, at_s = np.diff(facts.seconds)[longest], facts.seconds[longest]
        frame = int(facts.indices[longest])
        most = int(holes[longest])
        text += f"; most, {most} in {pause_s:.3f} s, after frame {frame} at {at_s:.3f} s"
    level = failed if percent > LOST_PERCENT else warning
    return level("gaps", text, **values)


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
        percent = 100 * len(still) / len(steps)
        text = f"{counted(len(still), 'frame')} at the time of another, first {frame}: "
        text += f"{percent:.3g} % (limit {IRREGULAR_PERCENT:g} %)"
        level = failed if percent > IRREGULAR_PERCENT else warning
        return level("stamps", text, percent_still=percent)
    return ok("stamps", "each is later than the one before")


def rate(facts: Facts) -> Verdict:
    """Frames come regularly."""
    pace = facts.pace
    if pace is None:
        return ok("rate", "too few frames to tell")
    percent = 100 * float(pace.off[pace.there].mean())
    hz = 1e9 / pace.usual_ns
    values = {"rate_hz": hz, "percent_irregular": percent}
    irregular = f"{percent:.1f} % of the intervals off by half of one or more"
    text = f"{hz:.2f} frames/s, "
    if percent > IRREGULAR_PERCENT:
        irregular += f" (limit {IRREGULAR_PERCENT:g} %)"
        if pace.lost.sum() < _FEW_LOST * np.count_nonzero(pace.off):
            irregular += ": frames came late, and then several at once; these are no capture times"
        return failed("rate", f"{text}but {irregular}", **values)
    unusual = []
    steps_ns = np.diff(facts.timestamps_ns)
    made_up = np.where(pace.there & ~pace.lossy, pace.passed, 0.0)
    longest = int(np.argmax(made_up))
    if made_up[longest] - np.diff(facts.indices)[longest] > _PAUSE:
        pause_s, frame = steps_ns[longest] / 1e9, int(facts.indices[longest])
        unusual.append(f"a pause of {pause_s:.3f} s after frame {frame}, its frames in a burst")
    if percent > IRREGULAR_NOTED_PERCENT:
        unusual.append(f"{irregular} (limit {IRREGULAR_PERCENT:g} %)")
    changed = 100 * float(steps_ns[pace.changed].sum() / steps_ns[pace.there].sum())
    if changed > IRREGULAR_NOTED_PERCENT:
        other_hz = 1e9 / float(np.median(pace.expected_ns[pace.changed]))
        unusual.append(f"{other_hz:.2f} for {changed:.3g} % of the time")
    set_hz = facts.camera_rate_hz
    if set_hz and hz < _SLOWER * set_hz:
        unusual.append(f"the camera was set to {set_hz:.4g}: dark for its exposure, or frames lost")
    if unusual:
        return warning("rate", f"{text}but {'; '.join(unusual)}", **values)
    return ok("rate", text + irregular, **values)


def arrivals(facts: Facts) -> Verdict:
    """Frames arrive after they were captured, by one and the same clock, and none is late."""
    if not facts.live:
        return ok("arrivals", "not a live recording")
    behind_s = (facts.arrivals_ns - facts.timestamps_ns) / 1e9
    if len(behind_s) and abs(apart_s := float(np.median(behind_s))) > _CLOCKS_S:
        text = f"capture and arrival are {apart_s:.3f} s apart: of two clocks?"
        return warning("arrivals", text)
    if len(behind_s) and (ahead_s := -float(np.median(behind_s))) > _AHEAD_S:
        text = f"captures are stamped {1000 * ahead_s:.1f} ms after they arrived"
        return warning("arrivals", text)
    if late := facts.said("frames_late"):
        return warning("arrivals", f"{counted(late, 'frame')} late")
    usual = f"{1000 * float(np.median(behind_s)):.1f} ms after capture" if len(behind_s) else "none"
    return ok("arrivals", f"usually {usual}")
