"""map.yaml: where the markers are."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from pipeline.geometry import Pose
from pipeline.markers import (
    CORNER_SIGNS,
    Facing,
    Marker,
    MarkerMap,
    load_dictionary,
    marker_rotation,
)
from recorder.errors import InputError
from recorder.files.file_kinds import other_kind
from recorder.files.yaml_file import FileModel, inline_yaml, parse_yaml, problems, validate

Positive = Annotated[float, Field(gt=0)]
Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]

_WAYS = "xyz_m with yaw_deg and facing, xyz_m with quat_xyzw, or corners_m"


class _MarkerEntry(FileModel):
    id: Annotated[int, Field(ge=0)]
    xyz_m: Vector3 | None = None
    yaw_deg: float | None = None
    facing: Facing | None = None
    quat_xyzw: Quaternion | None = None
    corners_m: Annotated[list[Vector3], Field(min_length=4, max_length=4)] | None = None
    size_m: Positive | None = None
    std_m: Positive | None = None
    tags: list[str] = Field(default=[])

    def placement(self) -> frozenset[str]:
        keys = ("xyz_m", "yaw_deg", "facing", "quat_xyzw", "corners_m")
        return frozenset(key for key in keys if getattr(self, key) is not None)


class _MapFile(FileModel):
    frame: Annotated[str, Field(min_length=1)] = "map"
    dictionary: str
    size_m: Positive | None = None
    inverted: bool = False
    markers: Annotated[list[_MarkerEntry], Field(min_length=1)]


@dataclass(frozen=True, eq=False)
class MapReading:
    """What could be read of a map.yaml, and everything that is wrong with it.

    Attributes:
        dictionary: None where there is none that OpenCV knows.
        markers: every marker that has a place, also those whose id is there twice or not in the
            dictionary.
        problems: none where `parse_map` would read the file.
    """

    frame: str
    dictionary: str | None
    inverted: bool
    markers: tuple[Marker, ...]
    problems: tuple[InputError, ...]


def parse_map(data: bytes, path: Path) -> MarkerMap:
    """The marker map in the bytes of a map.yaml.

    Args:
        path: where the bytes come from, for the message.

    Raises:
        InputError: a wrong shape, an id twice or outside the dictionary, a marker that is placed
            in none or several of the three ways.
    """
    file = validate(_MapFile, parse_yaml(data, path), path)
    reading = _read(file, path)
    if reading.problems:
        raise reading.problems[0]
    return MarkerMap(file.frame, file.dictionary, reading.markers, file.inverted)


def read_map(data: bytes, path: Path) -> MapReading:
    """As `parse_map`, with every problem instead of the first, and what can be read in spite of it.

    Raises:
        InputError: not YAML, not keys and values, or another kind of file.
    """
    content = parse_yaml(data, path)
    if isinstance(content, dict) and (other := other_kind(content, _MapFile.model_fields, path)):
        raise other
    found = problems(_MapFile, content, path)
    if not found:
        return _read(_MapFile.model_validate(content), path)
    if not isinstance(content, dict):
        raise found[0]
    reading = _read(_readable_part(content), path)
    # What the shape already says is wrong is not said again as a consequence of it.
    told = {(problem.where or "").split(".")[0] for problem in found}
    others = (p for p in reading.problems if (p.where or "") not in told)
    return replace(reading, problems=(*found, *others))


class _Unread(FileModel):
    """In place of a marker that has the wrong shape, so that the others keep their index."""


class _ReadablePart(FileModel):
    frame: str = "map"
    dictionary: str = ""
    size_m: Positive | None = None
    inverted: bool = False
    markers: list[_MarkerEntry | _Unread] = Field(default=[])


def _readable_part(content: dict[Any, Any]) -> _ReadablePart:
    """Those keys and markers that are as they should be."""
    good = {
        key: content[key]
        for key in ("frame", "dictionary", "size_m", "inverted")
        if key in content and not problems(_ReadablePart, {key: content[key]}, Path())
    }
    entries = content.get("markers")
    sizeless = "size_m" in content and "size_m" not in good
    markers = [
        {}
        if problems(_MarkerEntry, entry, Path())
        or (sizeless and not {"size_m", "corners_m"} & set(entry))
        else entry
        for entry in (entries if isinstance(entries, list) else [])
    ]
    return _ReadablePart.model_validate(good | {"markers": markers})


def _read(file: _MapFile | _ReadablePart, path: Path) -> MapReading:
    markers: list[Marker] = []
    found: list[InputError] = []
    at: list[str] = []
    first_at: dict[int, int] = {}
    for i, entry in enumerate(file.markers):
        if isinstance(entry, _Unread):
            continue
        where = f"markers[{i}]"
        if entry.id in first_at:
            problem = (
                f"expected each id once, found {entry.id} again (first in "
                f"markers[{first_at[entry.id]}])"
            )
            found.append(InputError(path, problem, f"{where}.id"))
        first_at.setdefault(entry.id, i)
        try:
            markers.append(_marker(entry, file.size_m))
            at.append(f"{where} (id {entry.id})")
        except ValueError as error:
            found.append(InputError(path, str(error), f"{where} (id {entry.id})"))
    dictionary: str | None = file.dictionary
    try:
        load_dictionary(file.dictionary)
    except ValueError as error:
        dictionary = None
        found.append(InputError(path, str(error), "dictionary"))
    for marker, where in zip(markers if dictionary else [], at, strict=False):
        try:
            MarkerMap(file.frame, file.dictionary, (marker,))
        except ValueError as error:
            found.append(InputError(path, str(error), where))
    return MapReading(file.frame, dictionary, file.inverted, tuple(markers), tuple(found))


def parse_marker(
    entry: dict[str, Any], common_size_m: float | None, path: Path, where: str
) -> Marker:
    """One marker with the keys of a map.yaml, wherever they come from.

    Args:
        common_size_m: for a marker that has none of its own.
        where: line or key, for the message.

    Raises:
        InputError: as `parse_map`.
    """
    for problem in problems(_MarkerEntry, entry, path):
        raise InputError(path, problem.problem, ", ".join(filter(None, (where, problem.where))))
    try:
        return _marker(_MarkerEntry.model_validate(entry), common_size_m)
    except ValueError as error:
        raise InputError(path, str(error), where) from error


def _marker(entry: _MarkerEntry, common_size_m: float | None) -> Marker:
    tags = tuple(entry.tags)
    placement = entry.placement()
    if placement == {"corners_m"}:
        marker = Marker.from_corners(entry.id, entry.corners_m or [], entry.std_m, tags)
        if entry.size_m is not None and abs(marker.size_m - entry.size_m) > 0.05 * entry.size_m:
            raise ValueError(
                f"expected corners_m {entry.size_m} m apart (size_m), found {marker.size_m:.4f} m"
            )
        return marker
    size_m = entry.size_m if entry.size_m is not None else common_size_m
    if size_m is None:
        raise ValueError("expected size_m here or for the whole map, found none")
    if placement == {"xyz_m", "quat_xyzw"}:
        pose = Pose.from_quat(entry.xyz_m, entry.quat_xyzw)  # type: ignore[arg-type]
        return Marker.from_pose(entry.id, pose, size_m, entry.std_m, tags)
    if placement == {"xyz_m", "yaw_deg", "facing"}:
        return Marker.from_yaw(
            entry.id,
            entry.xyz_m,  # type: ignore[arg-type]
            math.radians(entry.yaw_deg or 0.0),
            entry.facing or "down",
            size_m,
            entry.std_m,
            tags,
        )
    found = ", ".join(sorted(placement)) or "none of them"
    raise ValueError(f"expected one way to place it ({_WAYS}), found {found}")


def map_yaml(marker_map: MarkerMap) -> bytes:
    """A map.yaml that `parse_map` reads back to the same map (to 1e-9 m)."""
    sizes = Counter(m.size_m for m in marker_map.markers if not measured_by_corners(m))
    common = sizes.most_common(1)[0][0] if sizes else None
    lines = [f"frame: {inline_yaml(marker_map.frame)}", f"dictionary: {marker_map.dictionary}"]
    if common is not None:
        lines.append(f"size_m: {inline_yaml(common)}")
    lines.append(f"inverted: {inline_yaml(marker_map.inverted)}")
    lines.append("markers:")
    lines += [f"  - {inline_yaml(_entry(marker, common))}" for marker in marker_map.markers]
    return ("\n".join(lines) + "\n").encode()


def _entry(marker: Marker, common_size_m: float | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": marker.id}
    if measured_by_corners(marker):
        entry["corners_m"] = marker.corners_m.tolist()
    else:
        entry["xyz_m"] = marker.centre_m.tolist()
        entry |= _orientation(marker)
        if marker.size_m != common_size_m:
            entry["size_m"] = marker.size_m
    if marker.std_m is not None:
        entry["std_m"] = marker.std_m
    if marker.tags:
        entry["tags"] = list(marker.tags)
    return entry


def _orientation(marker: Marker) -> dict[str, Any]:
    rotation = marker.T_map_marker.rotation
    # Rounded, so that 45 does not become 45.00000000000001.
    yaw_deg = round(math.degrees(math.atan2(rotation[1, 0], rotation[0, 0])), 10)
    facing: Facing
    for facing in ("up", "down"):
        if np.allclose(rotation, marker_rotation(math.radians(yaw_deg), facing), 0, 1e-11):
            return {"yaw_deg": yaw_deg, "facing": facing}
    return {"quat_xyzw": marker.T_map_marker.quat_xyzw.tolist()}


def measured_by_corners(marker: Marker) -> bool:
    """Whether the corners say more than the pose and the size."""
    square = marker.T_map_marker.apply(CORNER_SIGNS * (marker.size_m / 2.0))
    return not np.allclose(marker.corners_m, square, 0, 1e-10)
