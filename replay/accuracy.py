"""How far a replay's fixes and tracks are from the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.geometry import Array, wrap_angle
from recorder.files.truth_file import TruthPath

# The name under which the poses that no tracker has touched are reported.
FIXES = "fixes"

Report = dict[str, Any]


def errors(folder: Path, path: TruthPath | None) -> Report:
    """Errors of the fixes and of each tracker, by kind of truth, from the tables in `folder`.

    Returns:
        `exact`, `measured`: against timed poses; `path`: distances to the untimed path. Each has
        the fixes and the trackers by name. Kinds that there are none of are absent.
    """
    estimates = _estimates(folder)
    report: Report = {}
    truth = _truth(folder)
    for kind in ("exact", "measured"):
        if kind in truth:
            report[kind] = {
                name: timed_errors(estimate, truth[kind]) for name, estimate in estimates.items()
            }
    if path is not None:
        report["path"] = {
            name: path_errors(estimate[:, 1:3], path) for name, estimate in estimates.items()
        }
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


def _estimates(folder: Path) -> dict[str, Array]:
    """(N, 4) frame_index, x_m, y_m, yaw_rad of the `ok` fixes and of each tracker."""
    columns = ["frame_index", "x_m", "y_m", "yaw_rad"]
    fixes = pq.read_table(
        folder / "poses.parquet", columns=columns, filters=pc.field("status") == "ok"
    )
    estimates = {FIXES: _array(fixes, columns)}
    for name in tracker_names(folder):
        track = pq.read_table(
            folder / "tracks.parquet",
            columns=columns[:3],
            filters=pc.field("tracker") == name,
        )
        # The trackers know no heading.
        xy = _array(track, columns[:3])
        estimates[name] = np.column_stack([xy, np.full(len(xy), np.nan)])
    return estimates


def tracker_names(folder: Path) -> list[str]:
    """The trackers of a result, in the order of its settings."""
    first = next(
        pq.ParquetFile(folder / "tracks.parquet").iter_batches(4096, columns=["tracker"]), None
    )
    return [] if first is None else list(dict.fromkeys(first.column(0).to_pylist()))


def _truth(folder: Path) -> dict[str, Array]:
    """(N, 4) frame_index, x_m, y_m, yaw_rad by kind, at frames."""
    if not (folder / "truth.parquet").exists():
        return {}
    columns = ["frame_index", "x_m", "y_m", "yaw_rad"]
    table = pq.read_table(folder / "truth.parquet", columns=["kind", *columns])
    kinds = {}
    for kind in ("exact", "measured"):
        rows = _array(table.filter(pc.field("kind") == kind), columns)
        rows = rows[rows[:, 0] >= 0]
        if len(rows):
            kinds[kind] = rows
    return kinds


def _array(table: pa.Table, columns: list[str]) -> npt.NDArray[np.float64]:
    return np.column_stack([table.column(name).to_numpy().astype(np.float64) for name in columns])
