"""Rules on what is in a log: images, calibration, map and truth, and whether they fit."""

from __future__ import annotations

from collections import Counter
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
from recorder.verify.verdict import Verdict, failed, ok, warning

_CORRUPT_PERCENT = 1.0
# Truth so far from every marker is in other units or of another place.
_FAR_M = 50.0


def images(facts: Facts) -> Verdict:
    """There are images, all of one size, and they can be decoded."""
    if not len(facts.indices):
        return failed("images", "there are none")
    if len(facts.sizes) > 1:
        sizes = ", ".join(f"{n} of {w}x{h}" for (w, h), n in facts.sizes.most_common())
        return failed("images", f"expected one size, found {sizes}")
    if facts.faults:
        percent = 100 * len(facts.faults) / len(facts.indices)
        index, what = facts.faults[0]
        kinds = "" if len(Counter(text for _, text in facts.faults)) == 1 else " and other faults"
        text = f"{counted(len(facts.faults), 'frame')} corrupt ({percent:.2g} %), "
        text += f"first {index}: {what}{kinds}"
        known = percent <= _CORRUPT_PERCENT
        return warning("images", text) if known else failed("images", text)
    how = "decoded" if facts.decoded else "looked at"
    return ok("images", f"{counted(len(facts.indices), 'image')} {how}")


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
    for size in facts.sizes:
        if size != camera.image_size:
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
