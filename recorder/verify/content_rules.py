"""Rules on what is in a log: images, calibration, map and truth, and whether they fit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from pipeline.markers import MarkerMap
from recorder.bench.check.run import check_truth
from recorder.bench.check.time_rules import LogTimes
from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.info_text import counted
from recorder.log import topics
from recorder.maps.check import check_map
from recorder.maps.findings import Checked
from recorder.verify.facts import Facts
from recorder.verify.limits import CORRUPT_PERCENT
from recorder.verify.verdict import Verdict, failed, ok, warning


def images(facts: Facts) -> Verdict:
    """There are images, of one size, and nearly all of them can be decoded."""
    if not len(facts.indices):
        return failed("images", "there are none")
    other = sum(facts.sizes.values()) - max(facts.sizes.values(), default=0)
    bad = len(facts.faults) + other
    counted_then = facts.said("frames_corrupt") or 0
    if not facts.decoded and counted_then > bad:
        return _told_corrupt(counted_then, len(facts.indices))
    percent = 100 * bad / len(facts.indices)
    values = {"frames_corrupt": bad, "percent_corrupt": percent}
    if not bad:
        how = "decoded" if facts.decoded else "looked at"
        return ok("images", f"{counted(len(facts.indices), 'image')} {how}", **values)
    kinds, details = [], []
    if facts.faults:
        index, what = facts.faults[0]
        more = "" if len({text for _, text in facts.faults}) == 1 else " and other faults"
        kinds.append("corrupt")
        details.append(f"first {index}: {what}{more}")
    if other:
        kinds.append("of another size")
        sizes = ", ".join(f"{n} of {w}x{h}" for (w, h), n in facts.sizes.most_common())
        details.append(f"expected one size, found {sizes}")
    text = f"{counted(bad, 'frame')} {' or '.join(kinds)}, {percent:.3g} % "
    text += f"(limit {CORRUPT_PERCENT:g} %), {'; '.join(details)}"
    level = failed if percent > CORRUPT_PERCENT else warning
    return level("images", text, **values)


def _told_corrupt(bad: int, images: int) -> Verdict:
    """What the recorder found inside images that are not decoded now."""
    percent = 100 * bad / images
    level = failed if percent > CORRUPT_PERCENT else warning
    text = f"{counted(bad, 'frame')} corrupt by the recorder's count, {percent:.3g} % "
    text += f"(limit {CORRUPT_PERCENT:g} %)"
    return level("images", text, frames_corrupt=bad, percent_corrupt=percent)


def calibration(facts: Facts) -> Verdict:
    """There is a calibration, for images of this size."""
    data = facts.log.attachments.get(topics.CAMERA_FILE)
    try:
        # Another file that is malformed is no fault of this one.
        camera = parse_camera(data, Path(topics.CAMERA_FILE)) if data else facts.log.camera()
    except InputError as error:
        return failed("calibration", _within(error))
    if camera is None:
        return warning("calibration", "there is none: replay needs --camera")
    width, height = camera.image_size
    if (size := facts.image_size) is not None and size != camera.image_size:
        found = f"it is for {width}x{height}, the images are {size[0]}x{size[1]}"
        return failed("calibration", found)
    cx, cy = camera.camera_matrix[0, 2], camera.camera_matrix[1, 2]
    if not (0 <= cx < width and 0 <= cy < height):
        found = f"its principal point {cx:.1f}, {cy:.1f} is outside of the image"
        return warning("calibration", found)
    return ok("calibration", f"{camera.distortion_model}, {width}x{height} as the images")


def marker_map(facts: Facts) -> Verdict:
    """There is a map, and it is plausible."""
    data = facts.log.attachments.get(topics.MAP_FILE)
    if data is None:
        return warning("map", "there is none: replay needs --map")
    try:
        check = check_map(data, Path(topics.MAP_FILE))
    except InputError as error:
        return failed("map", _within(error))
    sane = f"{counted(len(check.markers), 'marker')}, {check.dictionary}"
    return _graded("map", check, [finding.text for finding in check.findings]) or ok("map", sane)


def truth(facts: Facts) -> Verdict:
    """What was measured is of this log and of this place: as `truth check` says."""
    name = next((name for name in topics.TRUTH_FILES if name in facts.log.attachments), None)
    if name is None:
        text = f"{facts.exact} exact poses" if facts.exact else "there is none"
        return ok("truth", text)
    data, times = facts.log.attachments[name], None
    # Every part has the truth of the whole recording.
    if len(facts.indices) and facts.all_here:
        numbers = int(facts.indices.min()), int(facts.indices.max())
        times = LogTimes(np.sort(facts.seconds), facts.marks, facts.log.start_ns, numbers)
    try:
        check = check_truth(data, Path(name), _map(facts), times)
    except InputError as error:
        return failed("truth", _within(error))
    held = (len(check.places), "place"), (check.trajectory_poses, "trajectory pose")
    text = ", ".join(counted(number, noun) for number, noun in held if number)
    return _graded("truth", check, [finding.text for finding in check.findings]) or ok(
        "truth", text or "a path"
    )


def _graded(rule: str, check: Checked, texts: Sequence[str]) -> Verdict | None:
    """What was found in a file, the worst first; None where that is nothing."""
    errors, warnings = check.count("error"), check.count("warning")
    if not errors and not warnings:
        return None
    text = f"{counted(errors, 'error')}, {counted(warnings, 'warning')}: {texts[0]}"
    return failed(rule, text) if errors else warning(rule, text)


def _map(facts: Facts) -> MarkerMap | None:
    data = facts.log.attachments.get(topics.MAP_FILE)
    with suppress(InputError):
        return parse_map(data, Path(topics.MAP_FILE)) if data else None
    return None


def _within(error: InputError) -> str:
    """Without the name of the log, which the reader knows."""
    return f"{error.where}: {error.problem}" if error.where else error.problem
