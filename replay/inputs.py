"""What a replay needs besides images: calibration, marker map, truth; from the log or files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.camera import Camera
from pipeline.markers import MarkerMap
from recorder.bench.marks import Mark, log_marks
from recorder.bench.timing import with_marks
from recorder.errors import InputError
from recorder.files.camera_file import camera_yaml, parse_camera
from recorder.files.map_file import map_yaml, parse_map
from recorder.files.truth_file import Truth, check_frame, parse_truth, truth_kind
from recorder.files.yaml_file import read_bytes
from recorder.log import topics
from recorder.log.derived import Known
from recorder.log.reader import LogReader


@dataclass(frozen=True)
class Overrides:
    """Files that take the place of what the log carries."""

    camera: Path | None = None
    map: Path | None = None
    truth: Path | None = None


@dataclass(frozen=True, eq=False)
class Inputs:
    """Attributes:
    truth: with the waypoints that are marked in the log as timed poses.
    files: bytes by file name, as they were used, to lie beside the results.
    truth_problems: what of the truth could not be used or needs a look, one line each.
    """

    camera: Camera
    marker_map: MarkerMap
    truth: Truth | None
    files: dict[str, bytes]
    truth_problems: tuple[str, ...] = ()


def gather_files(files: Mapping[str, bytes], source: str) -> Inputs:
    """What is attached to a log that is only being recorded, from `source`.

    Raises:
        InputError: calibration or map are not among it, or a file is wrong.
    """
    known = Known.parse(files)
    if known.camera is None:
        raise InputError(
            source, "expected a calibration, found none; give one with --camera camera.yaml"
        )
    if known.marker_map is None:
        raise InputError(source, "expected a marker map, found none; give one with --map map.yaml")
    used = {name: files[name] for name in (topics.CAMERA_FILE, topics.MAP_FILE)}
    used |= {name: data for name, data in files.items() if name.startswith("truth.")}
    truth, problems = _timed(known.truth, ())
    return Inputs(known.camera, known.marker_map, truth, used, problems)


def gather(reader: LogReader, overrides: Overrides) -> Inputs:
    """The log's own calibration, map and truth, or the files given instead.

    Raises:
        InputError: the log has no calibration or map and none is given, or a file is wrong.
    """
    files: dict[str, bytes] = {}
    if overrides.camera is not None:
        files["camera.yaml"] = read_bytes(overrides.camera)
        camera = parse_camera(files["camera.yaml"], overrides.camera)
    else:
        logged_camera = reader.camera()
        if logged_camera is None:
            raise InputError(
                reader.path,
                "expected a calibration, found none; give one with --camera camera.yaml",
            )
        camera = logged_camera
        files["camera.yaml"] = reader.attachments.get("camera.yaml") or camera_yaml(camera)
    if overrides.map is not None:
        files["map.yaml"] = read_bytes(overrides.map)
        marker_map = parse_map(files["map.yaml"], overrides.map)
    else:
        logged_map = reader.marker_map()
        if logged_map is None:
            raise InputError(
                reader.path, "expected a marker map, found none; give one with --map map.yaml"
            )
        marker_map = logged_map
        files["map.yaml"] = reader.attachments.get("map.yaml") or map_yaml(marker_map)
    if overrides.truth is not None:
        data = read_bytes(overrides.truth)
        truth: Truth | None = parse_truth(data, overrides.truth)
        files[f"truth.{truth_kind(data, overrides.truth)}"] = data
    else:
        truth = reader.truth()
        files.update({n: d for n, d in reader.attachments.items() if n.startswith("truth.")})
    if truth is not None:
        check_frame(truth, marker_map, overrides.truth or reader.path)
    marks = log_marks(reader) if truth is not None and truth.waypoints else ()
    truth, problems = _timed(truth, marks)
    return Inputs(camera, marker_map, truth, files, problems)


def _timed(truth: Truth | None, marks: Iterable[Mark]) -> tuple[Truth | None, tuple[str, ...]]:
    """The truth with its marked waypoints as timed poses, and what there is to say about it."""
    problems: list[str] = []
    if truth is not None and truth.waypoints:
        truth, unused = with_marks(truth, marks)
        problems += unused
    if truth is not None and truth.trajectory and (place := truth.trajectory.unsorted_at):
        problems.append(f"the truth's poses are not in order of time from {place} on: sorted")
    return truth, tuple(problems)
