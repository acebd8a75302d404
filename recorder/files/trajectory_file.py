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

from pipeline.geometry import Array, read_only
from recorder.errors import InputError

Stamps = npt.NDArray[np.int64]
Number = TypeVar("Number", int, float)

_POSE_COLUMNS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
# Rounded quaternions are off by 1e-6 or so; columns in another order by much more.
_QUATERNION_TOLERANCE = 0.01


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses T_map_camera of another system, in the order of their index or stamp.

    Attributes:
        frame_index: (N,) the log's sequence numbers; None where only times are known.
        timestamp_ns: (N,) capture times; None where only frame numbers are known.
        positions_m: (N, 3).
        quats_xyzw: (N, 4), of length 1.
    """

    frame_index: Stamps | None
    timestamp_ns: Stamps | None
    positions_m: Array
    quats_xyzw: Array

    def __len__(self) -> int:
        return len(self.positions_m)


def parse_csv(text: str, path: Path) -> Trajectory:
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
    missing = [name for name in _POSE_COLUMNS if name not in header]
    keys = [name for name in ("frame_index", "timestamp_ns") if name in header]
    if missing or not keys or len(set(header)) != len(header):
        raise InputError(
            path,
            f"expected frame_index or timestamp_ns, and {', '.join(_POSE_COLUMNS)}, each once, "
            f"found {', '.join(header) or 'nothing'}",
            "header",
        )
    stamps = {
        key: _column((row[header.index(key)] for row in rows), key, lines, path, _int64)
        for key in keys
    }
    columns = [header.index(name) for name in _POSE_COLUMNS]
    numbers = [
        _column((row[column] for row in rows), name, lines, path, _finite)
        for name, column in zip(_POSE_COLUMNS, columns, strict=True)
    ]
    return _trajectory(stamps.get("frame_index"), stamps.get("timestamp_ns"), numbers, lines, path)


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


def _int64(text: str) -> int:
    value = int(text)
    if not -(2**63) <= value < 2**63:
        raise ValueError(text)
    return value


def _seconds_to_ns(text: str) -> int:
    """Exact: a float64 of seconds since 1970 is good to 240 ns only."""
    return _int64(str(int((Decimal(text) * 10**9).to_integral_value())))
