"""truth.yaml and timed trajectories: where the camera really was."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.geometry import Array, read_only
from pipeline.markers import MarkerMap
from recorder.errors import InputError
from recorder.files.trajectory_file import Trajectory, parse_csv, parse_tum
from recorder.files.yaml_file import FileModel, parse_yaml, validate

TruthKind = Literal["yaml", "csv", "tum"]

__all__ = [
    "StoodPose",
    "Trajectory",
    "Truth",
    "TruthKind",
    "TruthPath",
    "check_frame",
    "parse_truth",
    "truth_kind",
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
    """A measured pose the camera stood at, from `from_s` to `to_s` of the log."""

    from_s: float
    to_s: float
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
    """

    frame: str | None
    method: str
    path: TruthPath | None = None
    poses: tuple[StoodPose, ...] = ()
    trajectory: Trajectory | None = None


class _PathEntry(FileModel):
    points_m: Annotated[
        list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=2)
    ]
    closed: bool = False
    std_m: Annotated[float, Field(gt=0)]


class _PoseEntry(FileModel):
    from_s: float
    to_s: float
    x_m: float
    y_m: float
    z_m: float | None = None
    yaw_deg: float | None = None
    std_m: Annotated[float, Field(gt=0)]

    @model_validator(mode="after")
    def _span(self) -> Self:
        if self.to_s <= self.from_s:
            raise ValueError(f"expected to_s after from_s ({self.from_s}), found {self.to_s}")
        return self


class _TruthFile(FileModel):
    frame: Annotated[str, Field(min_length=1)] = "map"
    method: str = ""
    path: _PathEntry | None = None
    poses: list[_PoseEntry] = Field(default=[])


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


def _parse_truth_yaml(data: bytes, path: Path) -> Truth:
    file = validate(_TruthFile, parse_yaml(data, path), path)
    if file.path is None and not file.poses:
        raise InputError(path, "expected a path, poses or both, found neither")
    order = sorted(range(len(file.poses)), key=lambda i: file.poses[i].from_s)
    for earlier, later in pairwise(order):
        if file.poses[later].from_s < file.poses[earlier].to_s:
            raise InputError(
                path,
                f"expected spans that do not overlap, found {file.poses[later].from_s} s inside "
                f"poses[{earlier}]",
                f"poses[{later}].from_s",
            )
    truth_path = None
    if file.path is not None:
        points_m = read_only(file.path.points_m, (-1, 2))
        truth_path = TruthPath(points_m, file.path.closed, file.path.std_m)
    return Truth(file.frame, file.method, truth_path, tuple(map(_stood, file.poses)))


def _stood(entry: _PoseEntry) -> StoodPose:
    yaw_rad = None if entry.yaw_deg is None else math.radians(entry.yaw_deg)
    return StoodPose(
        entry.from_s, entry.to_s, entry.x_m, entry.y_m, entry.z_m, yaw_rad, entry.std_m
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
