"""The map.txt of ROS's fiducial_slam.

A line per fiducial: id, x y z in metres, roll pitch yaw in degrees about the fixed axes x, y, z
(R = Rz(yaw) Ry(pitch) Rx(roll)), variance in m^2, number of observations, ids seen together with
it. The fiducial's frame is aruco_detect's, which is ours: x right, y up, z out of the face.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pipeline.geometry import Array, Pose, rotation_z
from pipeline.markers import Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.text import text_of
from recorder.maps.formats import (
    ExportedMap,
    ImportedMap,
    MapDefaults,
    build_map,
    left_behind,
)

_COLUMNS = "id x y z roll pitch yaw variance observations [ids...]"


def import_fiducial_slam(data: bytes, path: Path, defaults: MapDefaults) -> ImportedMap:
    """The fiducials as a map; std_m is the root of the variance, none where that is 0.

    Raises:
        InputError: not such a file, or no dictionary or size given.
    """
    text = text_of(data, path)
    if defaults.dictionary is None or defaults.size_m is None:
        raise InputError(path, "expected --dictionary and --size-m too: a map.txt says neither")
    markers = []
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        markers.append(_marker(fields, defaults.size_m, path, f"line {number}"))
    marker_map = build_map(markers, defaults.dictionary, path, defaults)
    return ImportedMap(marker_map, ("left behind: observations and links",))


def export_fiducial_slam(marker_map: MarkerMap) -> ExportedMap:
    """The map as a map.txt; a marker without std_m has variance 0."""
    notes = list(left_behind(marker_map, ("std",)))
    if any(marker.std_m is None for marker in marker_map.markers):
        notes.append("markers without std_m have variance 0: fiducial_slam does not move them")
    lines = []
    for marker in marker_map.markers:
        roll, pitch, yaw = np.degrees(roll_pitch_yaw(marker.T_map_marker.rotation)).tolist()
        variance = 0.0 if marker.std_m is None else marker.std_m**2
        numbers = [*marker.centre_m.tolist(), roll, pitch, yaw, variance]
        lines.append(f"{marker.id} {' '.join(map(_plain, numbers))} 0\n")
    return ExportedMap("".join(lines).encode(), tuple(notes))


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles (3,) about the fixed axes x, y, z with Rz(yaw) Ry(pitch) Rx(roll) = rotation.

    Exact also where pitch is 90 degrees and only the sum of the other two is defined.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    rest = rotation_z(-yaw) @ rotation
    return np.array([math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw])


def _marker(fields: list[str], size_m: float, path: Path, where: str) -> Marker:
    if len(fields) < 9:
        raise InputError(path, f"expected {_COLUMNS}, found {len(fields)} fields", where)
    try:
        marker_id = int(fields[0])
        x, y, z, roll, pitch, yaw, variance = (float(field) for field in fields[1:8])
        int(fields[8])
    except ValueError as error:
        raise InputError(path, f"expected {_COLUMNS}, found: {error}", where) from error
    if not all(map(math.isfinite, (x, y, z, roll, pitch, yaw, variance))) or variance < 0:
        raise InputError(path, "expected finite numbers and a variance of 0 or more", where)
    rotation = (
        rotation_z(math.radians(yaw))
        @ _rotation_y(math.radians(pitch))
        @ _rotation_x(math.radians(roll))
    )
    std_m = math.sqrt(variance) or None
    return Marker.from_pose(marker_id, Pose(rotation, np.array([x, y, z])), size_m, std_m)


def _plain(value: float) -> str:
    """All digits, no exponent and no -0, for readers that do not know them."""
    return np.format_float_positional(value + 0.0, trim="0")


def _rotation_x(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rotation_y(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
