"""A truth.yaml from rows and columns that somebody counted on a chessboard floor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

from recorder.files.truth_entries import (
    FloorEntry,
    PathEntry,
    TruthFile,
    WaypointEntry,
    check_name,
)


def parse_square(text: str) -> float:
    """The side of a square: `0.25`, or `1/6`, which no decimal says exactly.

    Raises:
        ValueError: not a length above 0.
    """
    try:
        side = float(Fraction(text))
    except (ValueError, ZeroDivisionError, OverflowError):
        side = 0.0
    if not side > 0:
        raise ValueError(f"expected a length in metres such as 0.25 or 1/6, found {text!r}")
    return side


def parse_numbers(text: str, counts: tuple[int, ...], expected: str) -> list[float]:
    """Numbers with commas between them.

    Raises:
        ValueError: not as many as one of `counts`, or not finite.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        raise ValueError(f"expected {expected}, found {text!r}")
    return numbers


def waypoints(points: Sequence[str], std_m: float, z_m: float | None = None) -> list[WaypointEntry]:
    """From texts `[NAME=]ROW,COL[,HEADING]`; those without a name are called by their number.

    Raises:
        ValueError: another form, or a name twice.
    """
    entries: list[WaypointEntry] = []
    for i, text in enumerate(points, 1):
        before, equals, place = text.rpartition("=")
        name = check_name(before.strip()) if equals else str(i)
        if any(entry.name.casefold() == name.casefold() for entry in entries):
            raise ValueError(f"expected each name once, found {name} again ({text})")
        row, col, *heading = parse_numbers(
            place, (2, 3), "[NAME=]ROW,COL[,HEADING] such as 4,7,90 or a=4,7"
        )
        entries.append(
            WaypointEntry(
                name=name,
                row=row,
                col=col,
                heading_deg=heading[0] if heading else None,
                z_m=z_m,
                std_m=std_m,
            )
        )
    return entries


def path(text: str, floor: FloorEntry, *, closed: bool, std_m: float) -> PathEntry:
    """From `ROW,COL ROW,COL ...`; in metres of the map, to the micrometre.

    Raises:
        ValueError: another form, or fewer than two points.
    """
    places = [parse_numbers(part, (2,), "ROW,COL ROW,COL ...") for part in text.split()]
    if len(places) < 2:
        raise ValueError(f"expected at least two points ROW,COL, found {text!r}")
    placed = (floor.floor().place(row, col) for row, col in places)
    points_m = [[round(x_m, 6), round(y_m, 6)] for x_m, y_m in placed]
    return PathEntry(points_m=points_m, closed=closed, std_m=std_m)


def floor_truth(
    floor: FloorEntry,
    entries: list[WaypointEntry],
    driven: PathEntry | None,
    *,
    frame: str = "map",
    method: str = "",
) -> TruthFile:
    """The whole file; rows and columns stay as they were counted.

    Raises:
        ValueError: there is nothing in it.
    """
    if not entries and driven is None:
        raise ValueError("expected points or --path, found neither")
    return TruthFile(
        frame=frame,
        method=method or f"chessboard floor, squares of {floor.square_m:.6g} m",
        path=driven,
        floor=floor if entries else None,
        waypoints=entries,
    )
