"""WPILib's AprilTagFieldLayout: the JSON of FRC fields, PhotonVision and Limelight.

A tag's frame there has x out of its face, y to the right of who looks at it, z up; quaternions
are W, X, Y, Z; metres. Up is that of AprilTag's own drawings, which OpenCV's are turned against by
180 degrees: in our marker's axes the tag's are x_tag = z, y_tag = -x, z_tag = -y.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field

from pipeline.geometry import Pose
from pipeline.markers import Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.text import text_of
from recorder.files.yaml_file import FileModel, validate
from recorder.maps.formats import (
    ExportedMap,
    ImportedMap,
    MapDefaults,
    build_map,
    left_behind,
)

# Those of FRC fields since 2024; 2023's were 16h5 of 0.1524 m.
DICTIONARY = "DICT_APRILTAG_36h11"
SIZE_M = 0.1651

# Columns: our x, y, z in the tag's frame.
_T_tag_marker = Pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))


class _Part(FileModel):
    """Other keys are the business of other tools."""

    model_config = ConfigDict(extra="ignore")


class _Translation(_Part):
    x: float
    y: float
    z: float


class _Quaternion(_Part):
    W: float
    X: float
    Y: float
    Z: float


class _Rotation(_Part):
    quaternion: _Quaternion


class _Pose(_Part):
    translation: _Translation
    rotation: _Rotation


class _Tag(_Part):
    ID: Annotated[int, Field(ge=0)]
    pose: _Pose


class _Field(_Part):
    length: float
    width: float


class _Layout(_Part):
    tags: Annotated[list[_Tag], Field(min_length=1)]
    field: _Field | None = None


def import_wpilib(data: bytes, path: Path, defaults: MapDefaults) -> ImportedMap:
    """The field layout as a map.

    Raises:
        InputError: not such a layout, or a dictionary that is no AprilTag family.
    """
    dictionary = defaults.dictionary or DICTIONARY
    _check_family(dictionary, path, "--dictionary")
    text = text_of(data, path)
    try:
        content = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        if not text.strip():
            raise InputError(path, "expected JSON, found an empty file") from error
        line = getattr(error, "lineno", None)
        where = f"line {line}" if line else None
        raise InputError(path, f"expected JSON, found: {error}", where) from error
    layout = validate(_Layout, content, path)
    size_m = defaults.size_m or SIZE_M
    markers = []
    for i, tag in enumerate(layout.tags):
        place, turn = tag.pose.translation, tag.pose.rotation.quaternion
        try:
            T_map_tag = Pose.from_quat(
                [place.x, place.y, place.z], [turn.X, turn.Y, turn.Z, turn.W]
            )
        except ValueError as error:
            raise InputError(path, str(error), f"tags[{i}].pose.rotation.quaternion") from error
        markers.append(Marker.from_pose(tag.ID, T_map_tag @ _T_tag_marker, size_m))
    notes = []
    if defaults.dictionary is None or defaults.size_m is None:
        notes.append(
            f"assumed: {dictionary}, {size_m:g} m; the file does not say "
            "(--dictionary and --size-m do)"
        )
    if layout.field is not None:
        length, width = layout.field.length, layout.field.width
        notes.append(
            f"not in a map: the field of {length:g} x {width:g} m "
            f"(map export --field-m {length:g} {width:g} writes it again)"
        )
    return ImportedMap(build_map(markers, dictionary, path, defaults), tuple(notes))


def export_wpilib(
    marker_map: MarkerMap, path: Path, field_m: tuple[float, float] | None = None
) -> ExportedMap:
    """The map as a field layout.

    Args:
        field_m: length (x) and width (y) of the field; None: as far as the markers reach.

    Raises:
        InputError: the dictionary is no AprilTag family.
    """
    _check_family(marker_map.dictionary, path, "dictionary")
    notes = list(left_behind(marker_map, ()))
    corners = np.concatenate([marker.corners_m for marker in marker_map.markers])
    if field_m is None:
        length, width = (max(0.0, float(value)) for value in corners[:, :2].max(axis=0))
        field_m = (length, width)
        notes.append(f"field of {length:.3f} x {width:.3f} m: as far as markers reach (--field-m)")
    if corners[:, :2].min() < 0:
        notes.append("some markers are at negative x or y: a WPILib field begins at 0, 0")
    layout = {
        "tags": [_tag(marker) for marker in marker_map.markers],
        "field": {"length": field_m[0], "width": field_m[1]},
    }
    return ExportedMap((json.dumps(layout, indent=2) + "\n").encode(), tuple(notes))


def _tag(marker: Marker) -> dict[str, object]:
    T_map_tag = marker.T_map_marker @ _T_tag_marker.inverse()
    x, y, z = T_map_tag.translation.tolist()
    qx, qy, qz, qw = T_map_tag.quat_xyzw.tolist()
    return {
        "ID": marker.id,
        "pose": {
            "translation": {"x": x, "y": y, "z": z},
            "rotation": {"quaternion": {"W": qw, "X": qx, "Y": qy, "Z": qz}},
        },
    }


def _check_family(dictionary: str, path: Path, where: str) -> None:
    if not dictionary.startswith("DICT_APRILTAG_"):
        raise InputError(
            path,
            f"expected an AprilTag family such as {DICTIONARY}, as WPILib's layouts are for; "
            f"found {dictionary}",
            where,
        )
