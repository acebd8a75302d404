"""Is a map plausible? Everything that can be said without an image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.markers import Marker, load_dictionary
from recorder.errors import InputError
from recorder.files.map_file import read_map
from recorder.maps.few import few_findings
from recorder.maps.findings import Checked, Finding, Severity
from recorder.maps.pattern import pattern_findings
from recorder.maps.plausibility import (
    direction_text,
    plausibility_findings,
    plausible_size,
    tilt_deg,
)
from recorder.maps.spacing import Neighbour, nearest_neighbours, spacing_findings
from recorder.maps.units import unit_findings

# Each is the beginning of the next.
_FAMILY_SIZES = (50, 100, 250, 1000)


@dataclass(frozen=True)
class MarkerRow:
    """One marker, as the table shows it.

    Attributes:
        facing: `up`, `down`, or the heading that a wall's marker looks to.
        tilt_deg: from lying flat or hanging upright, whichever is nearer.
    """

    id: int
    xyz_m: tuple[float, float, float]
    size_m: float
    facing: str
    tilt_deg: float
    nearest: Neighbour | None


@dataclass(frozen=True)
class MapCheck(Checked):
    """What a map holds and what is odd about it, the worst first."""

    frame: str
    dictionary: str | None
    inverted: bool
    markers: tuple[MarkerRow, ...]
    findings: tuple[Finding, ...]

    @property
    def _graded(self) -> Sequence[Finding]:
        return self.findings


def check_map(data: bytes, path: Path) -> MapCheck:
    """Every problem of a map.yaml, those that keep it from being read included.

    Raises:
        InputError: it is not YAML or not keys and values, so that there is nothing to check.
    """
    reading = read_map(data, path)
    modules = None
    if reading.dictionary is not None:
        modules = load_dictionary(reading.dictionary).markerSize + 2
    markers = reading.markers
    found = [
        *(_unreadable(problem) for problem in reading.problems),
        *plausibility_findings(markers),
        *unit_findings(markers),
        *few_findings(markers),
        *pattern_findings(markers),
        # What a marker of 150 m covers says nothing about where it is.
        *spacing_findings([marker for marker in markers if plausible_size(marker)], modules),
        *_smaller_dictionary(reading.dictionary, markers),
    ]
    order: list[Severity] = ["error", "warning", "note"]
    found.sort(key=lambda finding: order.index(finding.severity))
    return MapCheck(
        str(path),
        reading.frame,
        reading.dictionary,
        reading.inverted,
        tuple(_rows(markers)),
        tuple(found),
    )


def _unreadable(problem: InputError) -> Finding:
    where = f"{problem.where}: " if problem.where else ""
    return Finding("error", "file", (), f"{where}{problem.problem}")


def _rows(markers: tuple[Marker, ...]) -> list[MarkerRow]:
    neighbours = nearest_neighbours(markers)
    return [
        MarkerRow(
            marker.id,
            (float(marker.centre_m[0]), float(marker.centre_m[1]), float(marker.centre_m[2])),
            marker.size_m,
            direction_text(marker.normal),
            tilt_deg(marker),
            nearest,
        )
        for marker, nearest in zip(markers, neighbours, strict=True)
    ]


def _smaller_dictionary(name: str | None, markers: tuple[Marker, ...]) -> list[Finding]:
    family, _, count = (name or "").rpartition("_")
    if not markers or not count.isdigit():
        return []
    highest = max(marker.id for marker in markers)
    for size in _FAMILY_SIZES:
        if highest < size < int(count):
            text = (
                f"{family}_{size} has the same markers and all ids up to {highest}; "
                f"detection is faster with it than with {name}"
            )
            return [Finding("note", "dictionary", (), text)]
    return []
