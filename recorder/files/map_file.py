"""map.yaml: where the markers are."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field

from pipeline.geometry import Pose
from pipeline.markers import CORNER_SIGNS, Facing, Marker, MarkerMap, marker_rotation
from recorder.errors import InputError
from recorder.files.yaml_file import FileModel, parse_yaml, validate

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


def parse_map(data: bytes, path: Path) -> MarkerMap:
    """The marker map in the bytes of a map.yaml.

    Args:
        path: where the bytes come from, for the message.

    Raises:
        InputError: a wrong shape, an id twice or outside the dictionary, a marker that is placed
            in none or several of the three ways.
    """
    file = validate(_MapFile, parse_yaml(data, path), path)
    markers = []
    first_at: dict[int, int] = {}
    for i, entry in enumerate(file.markers):
        where = f"markers[{i}]"
        if entry.id in first_at:
            raise InputError(
                path,
                f"expected each id once, found {entry.id} again (first in "
                f"markers[{first_at[entry.id]}])",
                f"{where}.id",
            )
        first_at[entry.id] = i
        try:
            markers.append(_marker(entry, file.size_m))
        except ValueError as error:
            raise InputError(path, str(error), f"{where} (id {entry.id})") from error
    try:
        return MarkerMap(file.frame, file.dictionary, tuple(markers), file.inverted)
    except ValueError as error:
        raise InputError(path, str(error)) from error


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
    sizes = Counter(m.size_m for m in marker_map.markers if not _measured_by_corners(m))
    common = sizes.most_common(1)[0][0] if sizes else None
    lines = [f"frame: {_inline(marker_map.frame)}", f"dictionary: {marker_map.dictionary}"]
    if common is not None:
        lines.append(f"size_m: {_inline(common)}")
    lines.append(f"inverted: {_inline(marker_map.inverted)}")
    lines.append("markers:")
    lines += [f"  - {_inline(_entry(marker, common))}" for marker in marker_map.markers]
    return ("\n".join(lines) + "\n").encode()


def _entry(marker: Marker, common_size_m: float | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": marker.id}
    if _measured_by_corners(marker):
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


def _measured_by_corners(marker: Marker) -> bool:
    """Whether the corners say more than the pose and the size."""
    square = marker.T_map_marker.apply(CORNER_SIGNS * (marker.size_m / 2.0))
    return not np.allclose(marker.corners_m, square, 0, 1e-10)


def _inline(value: Any) -> str:
    text: str = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False)
    return text.removesuffix("\n").removesuffix("\n...")
