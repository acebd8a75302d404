"""truth.yaml and timed trajectories: where the camera really was."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from pipeline.geometry import Array, read_only
from pipeline.markers import MarkerMap
from recorder.bench.floor import Floor
from recorder.errors import InputError
from recorder.files.trajectory_file import Trajectory, parse_csv, parse_tum
from recorder.files.truth_entries import PoseEntry, TruthFile, WaypointEntry
from recorder.files.yaml_file import parse_yaml, problems, validate

TruthKind = Literal["yaml", "csv", "tum"]

__all__ = [
    "StoodPose",
    "Trajectory",
    "Truth",
    "TruthKind",
    "TruthPath",
    "Waypoint",
    "check_frame",
    "parse_truth",
    "truth_kind",
    "truth_problems",
]


@dataclass(frozen=True, eq=False)
class TruthPath:
    """A path that was driven, without times.

    Attributes:
        points_m: (N, 2) corners in map x, y.
        closed: the last point joins the first.
        std_m: uncertainty across the path.
    """

    points_m: Array
    closed: bool
    std_m: float


@dataclass(frozen=True)
class StoodPose:
    """A measured pose the camera stood at, from `from_s` to `to_s` of the log.

    Attributes:
        name: of the waypoint, where it is one.
    """

    from_s: float
    to_s: float
    x_m: float
    y_m: float
    z_m: float | None
    yaw_rad: float | None
    std_m: float
    name: str | None = None


@dataclass(frozen=True)
class Waypoint:
    """A measured pose without a time; the marks in a log say when the camera was there."""

    name: str
    x_m: float
    y_m: float
    z_m: float | None
    yaw_rad: float | None
    std_m: float


@dataclass(frozen=True, eq=False)
class Truth:
    """The ground truth of a session.

    Attributes:
        frame: the map frame it is given in; None where the file does not say (TUM, CSV).
        method: how it was measured, in words.
        poses: in the order of their times.
    """

    frame: str | None
    method: str
    path: TruthPath | None = None
    poses: tuple[StoodPose, ...] = ()
    trajectory: Trajectory | None = None
    waypoints: tuple[Waypoint, ...] = ()

    @property
    def places(self) -> tuple[StoodPose | Waypoint, ...]:
        """Where the camera stood or is to come by."""
        return (*self.poses, *self.waypoints)


def parse_truth(data: bytes, path: Path) -> Truth:
    """The truth in a truth.yaml, a TUM text or a CSV file.

    Args:
        path: where the bytes come from; its suffix decides what they are, else their first line.

    Raises:
        InputError: names the key or line.
    """
    kind = truth_kind(data, path)
    if kind == "yaml":
        return _parse_truth_yaml(data, path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(path, "expected UTF-8 text, found other bytes", f"line {line}") from error
    trajectory = parse_csv(text, path) if kind == "csv" else parse_tum(text, path)
    return Truth(frame=None, method="", trajectory=trajectory)


def truth_kind(data: bytes, path: Path) -> TruthKind:
    """What kind of truth file it is, which is also the suffix of its name in a log."""
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return "yaml"
    if suffix == ".csv":
        return "csv"
    if suffix == ".tum":
        return "tum"
    lines = data[:65536].decode("utf-8", "replace").splitlines()
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    if "x_m" in [name.strip() for name in first.split(",")]:
        return "csv"
    fields = first.split()
    if len(fields) == 8 and all(_is_number(field) for field in fields):
        return "tum"
    return "yaml"


def check_frame(truth: Truth, marker_map: MarkerMap, path: Path) -> None:
    """Truth and map must speak of one frame, where the truth says which.

    Raises:
        InputError: they do not.
    """
    if truth.frame is not None and truth.frame != marker_map.frame:
        raise InputError(
            path, f"expected the map's frame {marker_map.frame!r}, found {truth.frame!r}", "frame"
        )


def truth_problems(data: bytes, path: Path) -> list[InputError]:
    """Everything that keeps a truth.yaml from being read, of another file the first mistake.

    Raises:
        InputError: it is not YAML.
    """
    if truth_kind(data, path) == "yaml":
        content = parse_yaml(data, path)
        shape = problems(TruthFile, content, path)
        return shape or _contradictions(TruthFile.model_validate(content), path)
    try:
        parse_truth(data, path)
    except InputError as error:
        return [error]
    return []


def _parse_truth_yaml(data: bytes, path: Path) -> Truth:
    file = validate(TruthFile, parse_yaml(data, path), path)
    for problem in _contradictions(file, path):
        raise problem
    truth_path = None
    if file.path is not None:
        points_m = read_only(file.path.points_m, (-1, 2))
        truth_path = TruthPath(points_m, file.path.closed, file.path.std_m)
    floor = file.floor.floor() if file.floor is not None else None
    return Truth(
        file.frame,
        file.method,
        truth_path,
        tuple(sorted(map(_stood, file.poses), key=lambda pose: pose.from_s)),
        waypoints=tuple(_waypoint(entry, floor) for entry in file.waypoints),
    )


def _contradictions(file: TruthFile, path: Path) -> list[InputError]:
    """What is wrong although every key by itself is right."""
    if file.path is None and not file.poses and not file.waypoints:
        return [InputError(path, "expected a path, poses or both, or waypoints, found none")]
    found = []
    order = sorted(range(len(file.poses)), key=lambda i: file.poses[i].from_s)
    for earlier, later in pairwise(order):
        if file.poses[later].from_s < file.poses[earlier].to_s:
            problem = (
                f"expected spans that do not overlap, found {file.poses[later].from_s} s inside "
                f"poses[{earlier}]"
            )
            found.append(InputError(path, problem, f"poses[{later}].from_s"))
    first_at: dict[str, int] = {}
    for i, entry in enumerate(file.waypoints):
        name = entry.name.casefold()
        if name in first_at:
            problem = (
                f"expected each name once, found {entry.name} again (first in "
                f"waypoints[{first_at[name]}])"
            )
            found.append(InputError(path, problem, f"waypoints[{i}].name"))
        first_at.setdefault(name, i)
        if entry.on_floor and file.floor is None:
            problem = "expected floor: {square_m: ...} for rows and columns, found none"
            found.append(InputError(path, problem, f"waypoints[{i}]"))
    return found


def _stood(entry: PoseEntry) -> StoodPose:
    return StoodPose(
        entry.from_s,
        entry.to_s,
        entry.x_m,
        entry.y_m,
        entry.z_m,
        _radians(entry.yaw_deg),
        entry.std_m,
        entry.name,
    )


def _waypoint(entry: WaypointEntry, floor: Floor | None) -> Waypoint:
    """`floor`: is there for one that is given by row and column."""
    name, z_m = entry.name, entry.z_m
    if floor is None or entry.row is None or entry.col is None:
        x_m, y_m = entry.x_m or 0.0, entry.y_m or 0.0
        return Waypoint(name, x_m, y_m, z_m, _radians(entry.yaw_deg), entry.std_m)
    x_m, y_m = floor.place(entry.row, entry.col)
    heading_rad = _radians(entry.heading_deg)
    yaw_rad = None if heading_rad is None else floor.yaw_of(heading_rad)
    return Waypoint(name, x_m, y_m, floor.z_m if z_m is None else z_m, yaw_rad, entry.std_m)


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else math.radians(angle_deg)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
