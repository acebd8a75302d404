"""Rules on the file itself: is everything there that was written, and does it say so?"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from recorder.errors import InputError
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
    said = last.end or {}
    ended = said.get("ended", ending.COMPLETE)
    if ending.next_part(ended) is not None:
        return ok("end", "the end of a part, not of the recording")
    if problem := ending.shortfall(ended):
        return warning("end", problem)
    if last.lost_camera is not None:
        text = f"{ended}, but no frame came any more after: {last.lost_camera}"
        if seconds := said.get("connection_lost_s"):
            text += f" (in all {seconds} s without a connection)"
        return warning("end", text)
    return ok("end", ended)


def parts(facts: Facts) -> Verdict:
    """No part of the recording is missing; one before or after those that are here is no hole."""
    here = [part.number for part in facts.parts]
    gone = [n for n in range(1, here[-1]) if n not in here]
    goes_on = ending.next_part((facts.parts[-1].end or {}).get("ended", ""))
    if not gone and goes_on is None:
        return ok("parts", "one log" if len(here) == 1 else f"all {len(here)} parts")
    # Frame numbers and seconds count from the recording's first image in every part.
    before = np.repeat(facts.unseen, [part.images for part in facts.parts])
    hidden = np.diff(before, prepend=0) > 0
    frames = int((np.diff(facts.indices, prepend=-1) - 1)[hidden].sum())
    seconds = float(np.diff(facts.seconds, prepend=0.0)[hidden].sum())
    texts = []
    if gone:
        noun = "part" if len(gone) == 1 else "parts"
        numbers = ", ".join(map(str, gone))
        texts.append(f"without {noun} {numbers}: {counted(frames, 'frame')} in {seconds:.3f} s")
    if goes_on is not None:
        texts.append(f"the recording goes on in {goes_on}, which is not here")
    hole = any(number > here[0] for number in gone)
    return (failed if hole else warning)(
        "parts",
        "; ".join(texts),
        missing_parts=gone,
        frames_missing=frames,
        seconds_missing=seconds,
    )


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
    for name, number in found.items():
        said = facts.said(name)
        if said is not None and said != number:
            return failed("counts", f"{name}: the log says {said}, {number} are there")
    if text := _other_corrupt(facts):
        return failed("counts", text)
    dropped = facts.said("frames_dropped")
    if dropped is not None and dropped < missing:
        text = f"frames_dropped: the log says {dropped}, {missing} numbers are missing"
        return failed("counts", text)
    return ok("counts", f"{counted(len(facts.indices), 'frame')}, as the log says")


def _other_corrupt(facts: Facts) -> str | None:
    """What is wrong with the number of corrupt images that the log says.

    A recorder looks at every image from outside, and into some; what it finds inside may be counted
    in the next part.
    """
    said = facts.said("frames_corrupt")
    if said is None or len(facts.sizes) > 1:
        return None
    # Images of another size than the calibration's are told by that rule.
    with suppress(InputError):
        camera = facts.log.camera()
        if camera is not None and facts.sizes and camera.image_size not in facts.sizes:
            return None
    most = facts.cut
    if inside := facts.said("frames_inspected"):
        if facts.unseen.any() or not facts.decoded:
            most += inside
        else:
            most = len(facts.faults)
    if facts.cut <= said <= most:
        return None
    return f"frames_corrupt: the log says {said}, {most if said > most else facts.cut} are there"
