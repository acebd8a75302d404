"""Timed trajectories of another system: TUM text and CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array, Pose, read_only, rotation_z
from recorder.errors import InputError

Stamps = npt.NDArray[np.int64]
Number = TypeVar("Number", int, float)

_XY = ("x_m", "y_m")
_QUATERNION = ("qx", "qy", "qz", "qw")
# Rounded quaternions are off by 1e-6 or so; columns in another order by much more.
_QUATERNION_TOLERANCE = 0.01


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses T_map_camera of another system, in the order of their index or stamp.

    Attributes:
        frame_index: (N,) the log's sequence numbers; None where only times are known.
        timestamp_ns: (N,) capture times; None where only frame numbers are known.
        positions_m: (N, 3); z is NaN where it is not known.
        quats_xyzw: (N, 4), of length 1, or NaN where they are not known.
        known_yaw_rad: (N,) headings, for poses without a quaternion; None where there are none.
        unsorted_at: where the file's first pose that is earlier than the one before it stands;
            None for a file in order.
    """

    frame_index: Stamps | None
    timestamp_ns: Stamps | None
    positions_m: Array
    quats_xyzw: Array
    known_yaw_rad: Array | None = None
    unsorted_at: str | None = None

    def __len__(self) -> int:
        return len(self.positions_m)

    def yaw_rad(self, i: int) -> float:
        """Heading of pose i; NaN where it is not known."""
        quat = self.quats_xyzw[i]
        if np.isfinite(quat).all():
            return Pose.from_quat(self.positions_m[i], quat).yaw_rad
        return float("nan") if self.known_yaw_rad is None else float(self.known_yaw_rad[i])

    def pose_to_draw(self, i: int) -> Pose:
        """Pose i for viewers: level, at height 0 and with heading 0 where that is not known."""
        position = np.nan_to_num(self.positions_m[i])
        quat = self.quats_xyzw[i]
        if np.isfinite(quat).all():
            return Pose.from_quat(position, quat)
        return Pose(rotation_z(float(np.nan_to_num(self.yaw_rad(i)))), position)


def parse_csv(text: str, path: Path) -> Trajectory:
    """Columns `frame_index` or `timestamp_ns`, x_m, y_m, and as far as they are known z_m and
    qx, qy, qz, qw or yaw_deg or yaw_rad; there may be others.

    Raises:
        InputError: a column is missing or twice, or a line is not as it should be.
    """
    reader = csv.reader(io.StringIO(text))
    header: list[str] = []
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for row in reader:
            if not any(field.strip() for field in row) or row[0].startswith("#"):
                continue
            if not header:
                header = [name.strip() for name in row]
                continue
            if len(row) != len(header):
                raise InputError(
                    path,
                    f"expected {len(header)} columns, found {len(row)}",
                    f"line {reader.line_num}",
                )
            rows.append(row)
            lines.append(reader.line_num)
    except csv.Error as error:
        raise InputError(
            path, f"expected CSV, found: {error}", f"line {reader.line_num}"
        ) from error
    keys = [name for name in ("frame_index", "timestamp_ns") if name in header]
    turned = [name for name in _QUATERNION if name in header]
    if (
        not set(_XY) <= set(header)
        or not keys
        or len(set(header)) != len(header)
        or len(turned) not in (0, 4)
    ):
        raise InputError(
            path,
            "expected frame_index or timestamp_ns, x_m, y_m, perhaps z_m, perhaps qx, qy, qz, qw "
            f"or yaw_deg, each once, found {', '.join(header) or 'nothing'}",
            "header",
        )

    def column(name: str, convert: Callable[[str], Number]) -> list[Number]:
        position = header.index(name)
        return _column((row[position] for row in rows), name, lines, path, convert)

    stamps = {key: column(key, _int64) for key in keys}
    unknown = [math.nan] * len(rows)
    numbers = [column(name, _finite) for name in _XY]
    numbers.append(column("z_m", _finite_or_unknown) if "z_m" in header else unknown)
    numbers += [column(name, _finite) if turned else unknown for name in _QUATERNION]
    yaw_rad = None
    if not turned and "yaw_deg" in header:
        yaw_rad = np.radians(column("yaw_deg", _finite_or_unknown))
    elif not turned and "yaw_rad" in header:
        yaw_rad = np.array(column("yaw_rad", _finite_or_unknown))
    return _trajectory(
        stamps.get("frame_index"), stamps.get("timestamp_ns"), numbers, lines, path, yaw_rad
    )


def parse_tum(text: str, path: Path) -> Trajectory:
    rows: list[list[str]] = []
    lines: list[int] = []
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        if len(fields) != 8:
            raise InputError(
                path, f"expected t x y z qx qy qz qw, found {len(fields)} fields", f"line {number}"
            )
        rows.append(fields)
        lines.append(number)
    stamps = _column((row[0] for row in rows), "t", lines, path, _seconds_to_ns)
    numbers = [
        _column((row[i + 1] for row in rows), name, lines, path, _finite)
        for i, name in enumerate(("x", "y", "z", "qx", "qy", "qz", "qw"))
    ]
    return _trajectory(None, stamps, numbers, lines, path)


def _trajectory(
    frame_index: list[int] | None,
    timestamp_ns: list[int] | None,
    numbers: list[list[float]],
    lines: list[int],
    path: Path,
    yaw_rad: Array | None = None,
) -> Trajectory:
    """Sorted, with quaternions of length 1; a time or frame number twice is an error."""
    if not lines:
        raise InputError(path, "expected at least one pose, found none")
    poses = np.array(numbers, dtype=np.float64).T
    lengths = np.linalg.norm(poses[:, 3:], axis=1)
    wrong = np.flatnonzero(np.abs(lengths - 1.0) > _QUATERNION_TOLERANCE)
    if len(wrong):
        raise InputError(
            path,
            f"expected a quaternion qx qy qz qw of length 1, found {lengths[wrong[0]]:.4g}",
            f"line {lines[wrong[0]]}",
        )
    key = frame_index if frame_index is not None else timestamp_ns or []
    order = np.array(sorted(range(len(key)), key=lambda i: key[i]), dtype=np.int64)
    back = next((i for i in range(1, len(key)) if key[i] < key[i - 1]), None)
    for stamps in (frame_index, timestamp_ns):
        if stamps is None:
            continue
        for before, after in pairwise(order):
            if stamps[after] <= stamps[before]:
                raise InputError(
                    path,
                    f"expected increasing frame numbers and times, each once, found "
                    f"{stamps[after]} (also see line {lines[before]})",
                    f"line {lines[after]}",
                )
    return Trajectory(
        None if frame_index is None else _int64_array(frame_index, order),
        None if timestamp_ns is None else _int64_array(timestamp_ns, order),
        read_only(poses[order, :3]),
        read_only(poses[order, 3:] / lengths[order, None]),
        None if yaw_rad is None else read_only(yaw_rad[order]),
        None if back is None else f"line {lines[back]}",
    )


def _int64_array(values: list[int], order: Stamps) -> Stamps:
    array = np.array(values, dtype=np.int64)[order]
    array.flags.writeable = False
    return array


def _column(
    texts: Iterable[str],
    name: str,
    lines: list[int],
    path: Path,
    convert: Callable[[str], Number],
) -> list[Number]:
    values = []
    for text, line in zip(texts, lines, strict=True):
        try:
            values.append(convert(text))
        except (ValueError, InvalidOperation, OverflowError) as error:
            raise InputError(
                path, f"expected a number for {name}, found {text!r}", f"line {line}"
            ) from error
    return values


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _finite_or_unknown(text: str) -> float:
    """An empty cell says nothing."""
    return _finite(text) if text.strip() else math.nan


def _int64(text: str) -> int:
    value = int(text)
    if not -(2**63) <= value < 2**63:
        raise ValueError(text)
    return value


def _seconds_to_ns(text: str) -> int:
    """Exact: a float64 of seconds since 1970 is good to 240 ns only."""
    return _int64(str(int((Decimal(text) * 10**9).to_integral_value())))
