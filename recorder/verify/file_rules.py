"""Rules on the file itself: is everything there that was written, and does it say so?"""

from __future__ import annotations

import numpy as np

from recorder.info_text import counted
from recorder.log import ending
from recorder.verify.facts import Facts
from recorder.verify.verdict import Verdict, failed, ok, warning


def end(facts: Facts) -> Verdict:
    """The log has its end, and ended well."""
    last = facts.parts[-1]
    for part in facts.parts:
        if part.cut_short:
            return failed("end", f"{part.path.name} is {part.cut_short}; see arucolog recover")
        if part.end is None:
            return failed("end", f"{part.path.name} does not say how it ended")
    ended = (last.end or {}).get("ended", ending.COMPLETE)
    if (goes_on := ending.next_part(ended)) is not None:
        return warning("end", f"the recording goes on in {goes_on}, which was not given")
    if problem := ending.shortfall(ended):
        return warning("end", problem)
    return ok("end", ended)


def parts(facts: Facts) -> Verdict:
    """No part of the recording is missing."""
    if gone := facts.log.missing_parts:
        return warning("parts", gone)
    return ok("parts", "one log" if len(facts.parts) == 1 else f"all {len(facts.parts)} parts")


def checksums(facts: Facts) -> Verdict:
    """Every chunk and attachment, and what is between them, is as it was written."""
    for part in facts.parts:
        if part.damage:
            more = f", and {len(part.damage) - 1} more" if len(part.damage) > 1 else ""
            return failed("checksums", f"{part.path.name}: {part.damage[0]}{more}")
        if part.checksum is not None:
            return failed("checksums", f"{part.path.name}: {part.checksum}")
    return ok("checksums", "all that has a checksum is as it was written")


def index(facts: Facts) -> Verdict:
    """The index at the end names every chunk, and counts the images that are there."""
    for part in facts.parts:
        if part.index is not None:
            return failed("index", f"{part.path.name}: expected a whole index, found {part.index}")
        if part.indexed_images != part.images:
            found = f"{part.indexed_images} images in it, {part.images} in the log"
            return failed("index", f"{part.path.name}: expected a whole index, found {found}")
    return ok("index", "names every chunk")


def counts(facts: Facts) -> Verdict:
    """What the log says about itself at the end is what is in it."""
    if not any(part.said for part in facts.parts):
        return warning("counts", "the log says nothing about what is in it")
    # Gaps at a part's start are counted in it, so these are compared in all.
    missing = int(np.maximum(np.diff(facts.indices) - 1, 0)[facts.adjoin].sum())
    back = int((np.diff(facts.timestamps_ns) < 0)[facts.adjoin].sum())
    found = {"frames_written": len(facts.indices), "events": sum(p.events for p in facts.parts)}
    if not facts.unseen.any():
        found["frames_stamped_back"] = back
    if len(facts.sizes) <= 1:
        found["frames_corrupt"] = facts.cut
    for name, number in found.items():
        said = facts.said(name)
        if said is not None and said != number:
            return failed("counts", f"{name}: the log says {said}, {number} are there")
    dropped = facts.said("frames_dropped")
    if dropped is not None and dropped < missing:
        text = f"frames_dropped: the log says {dropped}, {missing} numbers are missing"
        return failed("counts", text)
    return ok("counts", f"{counted(len(facts.indices), 'frame')}, as the log says")


def gaps(facts: Facts) -> Verdict:
    """No frames were lost."""
    steps = np.diff(facts.indices)
    if (steps <= 0).any():
        after = int(facts.indices[np.flatnonzero(steps <= 0)[0]])
        return failed("gaps", f"frame numbers do not increase after frame {after}")
    missing = int((steps - 1).sum())
    dropped = max(missing, facts.said("frames_dropped") or 0)
    if not dropped:
        return ok("gaps", "no frame is missing")
    share = 100 * dropped / (dropped + len(facts.indices))
    where = ""
    if missing:
        longest = int(np.argmax(steps))
        at_s = float(facts.seconds[longest])
        where = f"; most, {int(steps[longest]) - 1}, at {at_s:.3f} s"
    return warning("gaps", f"{counted(dropped, 'frame')} lost ({share:.2g} %){where}")
