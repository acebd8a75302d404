"""How far a replay's fixes and tracks are from the truth."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.geometry import Array, wrap_angle
from recorder.files.truth_file import TruthPath

# The name under which the poses that no tracker has touched are reported.
FIXES = "fixes"

Report = dict[str, Any]


def errors(folder: Path, path: TruthPath | None, trackers: Iterable[str]) -> Report:
    """Errors of the fixes and of each tracker, by kind of truth, from the tables in `folder`.

    One estimate is in memory at a time, 32 bytes a frame, beside the truth.

    Returns:
        `exact`, `measured`: against timed poses; `path`: distances to the untimed path. Each has
        the fixes and the trackers by name. Kinds that there are none of are absent.
    """
    truth = _truth(folder)
    report: Report = {kind: {} for kind in truth}
    if path is not None:
        report["path"] = {}
    for name in (FIXES, *trackers):
        estimate = _fixes(folder) if name == FIXES else _track(folder, name)
        for kind, rows in truth.items():
            report[kind][name] = timed_errors(estimate, rows)
        if path is not None:
            report["path"][name] = path_errors(estimate[:, 1:3], path)
    return report


def timed_errors(estimate: Array, truth: Array) -> Report:
    """Errors in x, y, position and (where both know it) yaw, at frames that both have.

    Args:
        estimate, truth: (N, 4) frame_index, x_m, y_m, yaw_rad; NaN where there is none.
    """
    _, i, j = np.intersect1d(estimate[:, 0], truth[:, 0], return_indices=True)
    difference = estimate[i, 1:] - truth[j, 1:]
    position = np.hypot(difference[:, 0], difference[:, 1])
    report: Report = {
        "x_m": _statistics(difference[:, 0]),
        "y_m": _statistics(difference[:, 1]),
        "position_m": _statistics(position),
    }
    report["n"] = report["position_m"].pop("n")
    for axis in ("x_m", "y_m"):
        report[axis].pop("n")
        report[axis].pop("median")
    yaw = _statistics(wrap_angle(difference[:, 2]))
    if yaw.pop("n"):
        yaw.pop("median")
        report["yaw_rad"] = yaw
    return report


def path_errors(positions_m: Array, path: TruthPath) -> Report:
    """Distances of positions (N, 2) to a path, and the share inside its ±std band."""
    distance = distance_to_path(positions_m[np.isfinite(positions_m).all(axis=1)], path)
    report = _statistics(distance)
    inside = float((distance <= path.std_m).mean()) if len(distance) else None
    return {
        "n": report["n"],
        "rms_m": report["rmse"],
        "mean_m": report["mean"],
        "max_m": report["max"],
        "share_in_band": inside,
        "band_m": path.std_m,
    }


def distance_to_path(positions_m: Array, path: TruthPath) -> Array:
    """(N,) distance of each position (N, 2) to the nearest point of the polyline."""
    starts = path.points_m
    ends = np.roll(starts, -1, axis=0)
    if not path.closed:
        starts, ends = starts[:-1], ends[:-1]
    nearest = np.full(len(positions_m), np.inf)
    for start, end in zip(starts, ends, strict=True):
        side = end - start
        length2 = float(side @ side)
        share = (positions_m - start) @ side / length2 if length2 else np.zeros(len(positions_m))
        foot = start + np.clip(share, 0.0, 1.0)[:, None] * side
        nearest = np.minimum(nearest, np.linalg.norm(positions_m - foot, axis=1))
    return nearest


def _statistics(values: Array) -> Report:
    """n, rmse, mean, median and the largest magnitude, over finite values; None without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return {"n": 0, "rmse": None, "mean": None, "median": None, "max": None}
    return {
        "n": len(finite),
        "rmse": float(np.sqrt(np.mean(finite**2))),
        "mean": float(np.mean(finite)),
        "median": float(np.median(finite)),
        "max": float(np.abs(finite).max()),
    }


def measured_rows(folder: Path) -> int:
    """How many frames have a measured pose."""
    return len(_truth(folder).get("measured", ()))


def _fixes(folder: Path) -> Array:
    """(N, 4) frame_index, x_m, y_m, yaw_rad of the `ok` fixes."""
    columns = ["frame_index", "x_m", "y_m", "yaw_rad"]
    return _rows(folder / "poses.parquet", columns, ("status", "ok"))


def _track(folder: Path, name: str) -> Array:
    """(N, 4) as of the fixes; a tracker knows no heading."""
    xy = _rows(folder / "tracks.parquet", ["frame_index", "x_m", "y_m"], ("tracker", name))
    return np.column_stack([xy, np.full(len(xy), np.nan)])


def _truth(folder: Path) -> dict[str, Array]:
    """(N, 4) frame_index, x_m, y_m, yaw_rad by kind, at frames."""
    path = folder / "truth.parquet"
    if not path.exists():
        return {}
    columns = ["frame_index", "x_m", "y_m", "yaw_rad"]
    kinds = {kind: _rows(path, columns, ("kind", kind)) for kind in ("exact", "measured")}
    at_frames = {kind: rows[rows[:, 0] >= 0] for kind, rows in kinds.items()}
    return {kind: rows for kind, rows in at_frames.items() if len(rows)}


def _rows(path: Path, columns: list[str], where: tuple[str, str]) -> Array:
    """(N, columns) of the rows with a value in a column, read a row group at a time."""
    name, value = where
    parts = [np.empty((0, len(columns)))]
    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(columns=[*columns, name]):
            chosen = batch.filter(pc.equal(batch.column(name), value))
            parts.append(
                np.column_stack([chosen.column(c).to_numpy().astype(np.float64) for c in columns])
            )
    return np.concatenate(parts)
