"""Markers as CSV, for spreadsheets and for lists that total stations give.

Columns, in any order, known by the header: `marker_id`; a place as `x_m,y_m,z_m` with
`qx,qy,qz,qw` or with `yaw_deg,facing`, or the four corners `x0_m,y0_m,z0_m` to `x3_m,y3_m,z3_m`
(top left, top right, bottom right, bottom left); optionally `size_m`, `std_m` and `tags` with `;`
between them. Cells may be empty where another way places the marker. All mean what they do in
map.yaml.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

from pipeline.markers import Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.map_file import measured_by_corners, parse_marker
from recorder.files.text import text_of
from recorder.maps.formats import (
    ExportedMap,
    ImportedMap,
    MapDefaults,
    build_map,
    left_behind,
)

_XYZ = ("x_m", "y_m", "z_m")
_QUAT = ("qx", "qy", "qz", "qw")
_CORNERS = tuple(f"{axis}{i}_m" for i in range(4) for axis in "xyz")
_COLUMNS = ("marker_id", *_XYZ, *_QUAT, "yaw_deg", "facing", *_CORNERS, "size_m", "std_m", "tags")


def import_csv(data: bytes, path: Path, defaults: MapDefaults) -> ImportedMap:
    """The rows as a map.

    Raises:
        InputError: an unknown or missing column, a wrong value; or no dictionary given.
    """
    text = text_of(data, path)
    if defaults.dictionary is None:
        raise InputError(path, "expected --dictionary too: a CSV does not say it")
    reader = csv.reader(io.StringIO(text))
    header: list[str] = []
    markers = []
    try:
        for row in reader:
            if not any(cell.strip() for cell in row) or row[0].startswith("#"):
                continue
            where = f"line {reader.line_num}"
            if not header:
                header = _header(row, path)
                if defaults.size_m is None and not {"size_m", *_CORNERS} & set(header):
                    raise InputError(path, "expected --size-m too, or a column size_m")
                continue
            if len(row) != len(header):
                problem = f"expected {len(header)} columns, found {len(row)}"
                raise InputError(path, problem, where)
            cells = {name: cell.strip() for name, cell in zip(header, row, strict=True)}
            entry = _entry({name: cell for name, cell in cells.items() if cell}, path, where)
            markers.append(parse_marker(entry, defaults.size_m, path, where))
    except csv.Error as error:
        where = f"line {reader.line_num}"
        raise InputError(path, f"expected CSV, found: {error}", where) from error
    return ImportedMap(build_map(markers, defaults.dictionary, path, defaults), ())


def export_csv(marker_map: MarkerMap) -> ExportedMap:
    """All markers with quaternions; corners too where they say more than the pose."""
    by_corners = any(measured_by_corners(marker) for marker in marker_map.markers)
    columns = ["marker_id", *_XYZ, *_QUAT, *(_CORNERS if by_corners else ())]
    columns += ["size_m", "std_m", "tags"]
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, lineterminator="\n")
    writer.writeheader()
    for marker in marker_map.markers:
        writer.writerow(_row(marker))
    notes = left_behind(marker_map, ("size", "std", "tags", "corners"))
    return ExportedMap(out.getvalue().encode(), notes)


def _header(row: list[str], path: Path) -> list[str]:
    header = [name.strip() for name in row]
    unknown = [name for name in header if name not in _COLUMNS]
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and sign in row[0]:
            problem = f"expected commas between columns and points in numbers, found {name}"
            raise InputError(path, problem, "header")
    if unknown or "marker_id" not in header or len(set(header)) != len(header):
        raise InputError(
            path,
            f"expected marker_id and some of {', '.join(_COLUMNS[1:])}, each once, "
            f"found {', '.join(unknown or header)}",
            "header",
        )
    return header


def _entry(cells: dict[str, str], path: Path, where: str) -> dict[str, Any]:
    """The keys of map.yaml; cells that are empty are not there."""

    def number(name: str) -> float:
        try:
            value = float(cells[name])
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(path, f"expected a number for {name}, found {cells[name]!r}", where)
        return value

    def numbers(names: tuple[str, ...]) -> list[float]:
        missing = [name for name in names if name not in cells]
        if missing:
            raise InputError(path, f"expected {', '.join(missing)} too, found none", where)
        return [number(name) for name in names]

    try:
        entry: dict[str, Any] = {"id": int(cells.get("marker_id", ""))}
    except ValueError as error:
        found = cells.get("marker_id", "")
        raise InputError(path, f"expected a whole number, found {found!r}", where) from error
    if any(name in cells for name in _CORNERS):
        values = numbers(_CORNERS)
        entry["corners_m"] = [values[i : i + 3] for i in range(0, 12, 3)]
    if any(name in cells for name in _XYZ):
        entry["xyz_m"] = numbers(_XYZ)
    if any(name in cells for name in _QUAT):
        entry["quat_xyzw"] = numbers(_QUAT)
    entry |= {name: number(name) for name in ("yaw_deg", "size_m", "std_m") if name in cells}
    if "facing" in cells:
        entry["facing"] = cells["facing"]
    if "tags" in cells:
        entry["tags"] = [tag.strip() for tag in cells["tags"].split(";") if tag.strip()]
    return entry


def _row(marker: Marker) -> dict[str, Any]:
    row: dict[str, Any] = {"marker_id": marker.id}
    if measured_by_corners(marker):
        row |= zip(_CORNERS, marker.corners_m.ravel().tolist(), strict=True)
    else:
        row |= zip(_XYZ, marker.centre_m.tolist(), strict=True)
        row |= zip(_QUAT, marker.T_map_marker.quat_xyzw.tolist(), strict=True)
        row["size_m"] = marker.size_m
    if marker.std_m is not None:
        row["std_m"] = marker.std_m
    if marker.tags:
        row["tags"] = ";".join(marker.tags)
    return row
