"""Rules on what is in a log: images, calibration, map and truth, and whether they fit."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from pipeline.geometry import Array
from pipeline.markers import MarkerMap
from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.files.truth_file import Truth, check_frame, parse_truth
from recorder.info_text import counted
from recorder.log import topics
from recorder.maps.check import check_map
from recorder.verify.facts import Facts
from recorder.verify.limits import CORRUPT_PERCENT
from recorder.verify.verdict import Verdict, failed, ok, warning

# Truth so far from every marker is in other units or of another place.
_FAR_M = 50.0


def images(facts: Facts) -> Verdict:
    """There are images, of one size, and nearly all of them can be decoded."""
    if not len(facts.indices):
        return failed("images", "there are none")
    other = sum(facts.sizes.values()) - max(facts.sizes.values(), default=0)
    bad = len(facts.faults) + other
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
    errors, warnings = check.count("error"), check.count("warning")
    if errors or warnings:
        first = check.findings[0].text
        text = f"{counted(errors, 'error')}, {counted(warnings, 'warning')}: {first}"
        return failed("map", text) if errors else warning("map", text)
    return ok("map", f"{counted(len(check.markers), 'marker')}, {check.dictionary}")


def truth(facts: Facts) -> Verdict:
    """What was measured is of this log and of this place."""
    placed = _map(facts)
    try:
        measured = _truth(facts)
        if measured is not None and placed is not None:
            check_frame(measured, placed, Path("truth"))
    except InputError as error:
        return failed("truth", _within(error))
    if measured is None:
        text = f"{facts.exact} exact poses" if facts.exact else "there is none"
        return ok("truth", text)
    if outside := _out_of_time(measured, facts):
        return warning("truth", outside)
    points = _points(measured)
    if placed is not None and placed.markers and len(points):
        centres = np.array([marker.centre_m[:2] for marker in placed.markers])
        furthest_m = max(float(np.hypot(*(centres - p).T).min()) for p in points)
        if furthest_m > _FAR_M:
            return warning("truth", f"up to {furthest_m:.0f} m from every marker: in metres?")
    return ok("truth", measured.method or "of this log and of this place")


def _map(facts: Facts) -> MarkerMap | None:
    data = facts.log.attachments.get(topics.MAP_FILE)
    with suppress(InputError):
        return parse_map(data, Path(topics.MAP_FILE)) if data else None
    return None


def _truth(facts: Facts) -> Truth | None:
    for name in topics.TRUTH_FILES:
        if data := facts.log.attachments.get(name):
            return parse_truth(data, Path(name))
    return None


def _out_of_time(measured: Truth, facts: Facts) -> str | None:
    seconds = facts.seconds
    if not len(seconds):
        return None
    first_s, last_s = float(seconds.min()), float(seconds.max())
    for pose in measured.poses:
        if pose.to_s < first_s or pose.from_s > last_s:
            return (
                f"the pose from {pose.from_s:g} s to {pose.to_s:g} s is outside of the log, which "
                f"ends at {last_s:.3f} s"
            )
    trajectory = measured.trajectory
    if trajectory is None:
        return None
    stamps, taken = trajectory.timestamp_ns, facts.timestamps_ns
    if stamps is None:
        stamps, taken = trajectory.frame_index, facts.indices
    if stamps is not None and len(stamps) and (stamps[-1] < taken.min() or stamps[0] > taken.max()):
        return "the trajectory is of another time than the log"
    return None


def _points(measured: Truth) -> Array:
    """(N, 2) x and y of all that was measured."""
    found = [np.array([[pose.x_m, pose.y_m] for pose in measured.poses]).reshape(-1, 2)]
    if measured.path is not None:
        found.append(np.asarray(measured.path.points_m))
    if measured.trajectory is not None:
        found.append(np.asarray(measured.trajectory.positions_m)[:, :2])
    return np.vstack(found)


def _within(error: InputError) -> str:
    """Without the name of the log, which the reader knows."""
    return f"{error.where}: {error.problem}" if error.where else error.problem
