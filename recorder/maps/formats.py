"""Maps of other tools, and what each format cannot hold."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.markers import Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.map_file import measured_by_corners

FormatName = Literal["wpilib", "fiducial_slam", "csv"]
SUFFIXES: dict[str, FormatName] = {".json": "wpilib", ".txt": "fiducial_slam", ".csv": "csv"}


@dataclass(frozen=True)
class MapDefaults:
    """What a person adds to a file of another tool that does not say it; None: not given."""

    dictionary: str | None = None
    size_m: float | None = None
    frame: str = "map"
    inverted: bool = False


@dataclass(frozen=True)
class ImportedMap:
    """A map, and in a line each what was assumed or left behind."""

    marker_map: MarkerMap
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ExportedMap:
    """A file of another tool, and in a line each what it does not hold or had to be assumed."""

    data: bytes
    notes: tuple[str, ...]


def format_of(path: Path) -> FormatName:
    """By its suffix.

    Raises:
        InputError: none of the three.
    """
    name = SUFFIXES.get(path.suffix.lower())
    if name is None:
        known = ", ".join(f"{suffix} ({name})" for suffix, name in SUFFIXES.items())
        raise InputError(path, f"expected {known}, or --format; found {path.suffix or 'no suffix'}")
    return name


def import_map(data: bytes, path: Path, name: FormatName, defaults: MapDefaults) -> ImportedMap:
    """The map in the bytes of another tool's file.

    Raises:
        InputError: not of that format, or it needs what `defaults` does not give.
    """
    if name == "wpilib":
        from recorder.maps.wpilib import import_wpilib

        return import_wpilib(data, path, defaults)
    if name == "fiducial_slam":
        from recorder.maps.fiducial_slam import import_fiducial_slam

        return import_fiducial_slam(data, path, defaults)
    from recorder.maps.marker_csv import import_csv

    return import_csv(data, path, defaults)


def export_map(
    marker_map: MarkerMap,
    path: Path,
    name: FormatName,
    field_m: tuple[float, float] | None = None,
) -> ExportedMap:
    """The map as a file of another tool.

    Args:
        path: of the map, for messages.
        field_m: length and width of the field, for WPILib.

    Raises:
        InputError: the format is not for such a map.
    """
    if name == "wpilib":
        from recorder.maps.wpilib import export_wpilib

        return export_wpilib(marker_map, path, field_m)
    if name == "fiducial_slam":
        from recorder.maps.fiducial_slam import export_fiducial_slam

        return export_fiducial_slam(marker_map)
    from recorder.maps.marker_csv import export_csv

    return export_csv(marker_map)


def build_map(
    markers: Collection[Marker], dictionary: str, path: Path, defaults: MapDefaults
) -> MarkerMap:
    """Raises: InputError: no markers, an id twice, or one outside the dictionary."""
    try:
        return MarkerMap(defaults.frame, dictionary, tuple(markers), defaults.inverted)
    except ValueError as error:
        raise InputError(path, str(error)) from error


def left_behind(marker_map: MarkerMap, holds: Collection[str]) -> tuple[str, ...]:
    """One line with what is in the map and not in a file that only `holds` some of it.

    Args:
        holds: of size, std, tags and corners.
    """
    markers = marker_map.markers
    lost = [f"dictionary {marker_map.dictionary}", f"frame {marker_map.frame}"]
    if marker_map.inverted:
        lost.append("inverted")
    if "size" not in holds:
        sizes = sorted({round(marker.size_m, 6) for marker in markers})
        lost.append("size_m " + ", ".join(f"{size:g}" for size in sizes))
    if "std" not in holds and (count := sum(m.std_m is not None for m in markers)):
        lost.append(f"std_m of {count}")
    if "tags" not in holds and (count := sum(bool(m.tags) for m in markers)):
        lost.append(f"tags of {count}")
    if "corners" not in holds and (count := sum(measured_by_corners(m) for m in markers)):
        lost.append(f"corners of {count} as measured (the nearest squares are written)")
    return ("not in this format: " + "; ".join(lost),)
