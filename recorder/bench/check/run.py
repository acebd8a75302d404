"""All rules on one truth file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.markers import MarkerMap
from recorder.bench.check.findings import Place, TruthFinding, places
from recorder.bench.check.heading_rules import path_findings, unit_findings
from recorder.bench.check.place_rules import (
    map_findings,
    same_place_findings,
    square_findings,
    std_findings,
)
from recorder.bench.check.time_rules import (
    LogTimes,
    log_findings,
    order_findings,
    speed_findings,
)
from recorder.bench.timing import with_marks
from recorder.errors import InputError
from recorder.files.truth_entries import TruthFile
from recorder.files.truth_file import Truth, check_frame, parse_truth, truth_kind, truth_problems
from recorder.files.yaml_file import parse_yaml
from recorder.info_text import counted
from recorder.maps.findings import Checked, Severity


@dataclass(frozen=True)
class TruthCheck(Checked):
    """What a truth file holds and what is odd about it, the worst first.

    Attributes:
        timed_poses: of the file, and with a log those of its marks.
    """

    places: tuple[Place, ...]
    path_points: int
    timed_poses: int
    trajectory_poses: int
    findings: tuple[TruthFinding, ...]

    @property
    def _graded(self) -> Sequence[TruthFinding]:
        return self.findings


def check_truth(
    data: bytes, path: Path, marker_map: MarkerMap | None, log: LogTimes | None = None
) -> TruthCheck:
    """Everything that is odd about a truth file, what keeps it from being read included.

    Without a map nothing is said about places in it.

    Raises:
        InputError: it is not YAML.
    """
    problems = truth_problems(data, path)
    if problems:
        return TruthCheck(str(path), (), 0, 0, 0, tuple(map(_unreadable, problems)))
    truth = parse_truth(data, path)
    found: list[TruthFinding] = []
    try:
        if marker_map is not None:
            check_frame(truth, marker_map, path)
    except InputError as error:
        found.append(_unreadable(error))
    if truth_kind(data, path) == "yaml":
        file = TruthFile.model_validate(parse_yaml(data, path))
        found += [*order_findings(file), *square_findings(file), *unit_findings(file)]
    if log is not None and truth.waypoints:
        truth, unused = with_marks(truth, log.marks)
        found += [TruthFinding("warning", "marks", "", text) for text in unused]
    found += _findings(truth, marker_map, log)
    order: list[Severity] = ["error", "warning", "note"]
    found.sort(key=lambda finding: order.index(finding.severity))
    return TruthCheck(
        str(path),
        tuple(places(truth)),
        len(truth.path.points_m) if truth.path else 0,
        len(truth.poses),
        len(truth.trajectory) if truth.trajectory else 0,
        tuple(found),
    )


def check_text(check: TruthCheck) -> str:
    """The places, what was found, and the verdict."""
    rows = [("", "x_m", "y_m", "z_m", "yaw_deg", "std_m"), *map(_cells, check.places)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    if check.places:
        lines = [
            "  ".join((f"{row[0]:<{widths[0]}}", *map(str.rjust, row[1:], widths[1:])))
            for row in rows
        ]
        lines.append("")
    lines += [f"{finding.severity}: {finding.text}" for finding in check.findings]
    holds = [
        counted(number, noun)
        for number, noun in (
            (check.path_points, "path point"),
            (len(check.places), "place"),
            (check.timed_poses, "timed pose"),
            (check.trajectory_poses, "trajectory pose"),
        )
        if number
    ]
    verdict = "sane" if check.sane else "not usable as it is"
    counts = [counted(check.count("error"), "error"), counted(check.count("warning"), "warning")]
    lines.append(f"{check.path}: {verdict}; {', '.join(holds + counts)}")
    return "\n".join(lines)


def _findings(
    truth: Truth, marker_map: MarkerMap | None, log: LogTimes | None
) -> list[TruthFinding]:
    return [
        *(map_findings(truth, marker_map) if marker_map is not None else ()),
        *speed_findings(truth),
        *std_findings(truth),
        *same_place_findings(truth),
        *path_findings(truth),
        *(log_findings(truth, log) if log is not None else ()),
    ]


def _unreadable(problem: InputError) -> TruthFinding:
    where = f"{problem.where}: " if problem.where else ""
    return TruthFinding("error", "file", problem.where or "", f"{where}{problem.problem}")


def _cells(place: Place) -> tuple[str, ...]:
    return (
        place.label,
        f"{place.x_m:.3f}",
        f"{place.y_m:.3f}",
        "" if place.z_m is None else f"{place.z_m:.3f}",
        "" if place.yaw_rad is None else f"{math.degrees(place.yaw_rad):.1f}",
        f"{place.std_m:g}",
    )
