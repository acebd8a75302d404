"""The study's numbers, a row for each tracker and side: errors, smoothness, consistency."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.tracking.consistency import lag1, lag1_band, log_likelihood, nees, nis_test
from analysis.tracking.drive import Drive, Timeline, Track, timeline, tracks_of
from pipeline.geometry import Array
from replay.accuracy import FIXES, path_errors

# The row of a tracker over the whole drive.
ALL = "all"

# With fewer frames or updates a statistic is left empty.
MIN_COUNT = 10

# A track jumps to its first fixes; that is not what its smoothness is about.
SETTLED_S = 2.0

ACCURACY = (
    "frames",
    "rmse_x_cm",
    "rmse_y_cm",
    "rmse_position_cm",
    "path_rms_cm",
    "path_max_cm",
    "in_band_percent",
    "accel_rms_cmps2",
)
CONSISTENCY = (
    "updates",
    "nis_mean",
    "nis_low",
    "nis_high",
    "verdict",
    "nees_mean",
    "lag1_x",
    "lag1_y",
    "lag1_band",
    "log_likelihood",
)

Row = dict[str, object]


def drive_table(drive: Drive) -> pd.DataFrame:
    """Everything that the study measures.

    One row for the fixes and each tracker, over the whole drive and for each side of the path:
    `tracker`, `side`, `markers` (median of those used), then the columns `ACCURACY` and
    `CONSISTENCY`. NaN (`verdict`: empty) where fewer than `MIN_COUNT` values are known.
    """
    frames = timeline(drive)
    spans = [(ALL, np.ones(len(frames.side), dtype=np.bool_))]
    if len(frames.sides) > 1:
        spans += [(side.name, frames.side == i) for i, side in enumerate(frames.sides)]
    rows: list[Row] = []
    for name, inside in spans:
        used = frames.n_used[inside & (frames.n_used > 0)]
        markers = float(np.median(used)) if len(used) else np.nan
        shared: Row = {"side": name, "markers": markers}
        rows.append({"tracker": FIXES, **shared, **_accuracy(drive, frames, frames.fix_m, inside)})
        for track in tracks_of(drive):
            accuracy = _accuracy(drive, frames, track.position_m, inside)
            consistency = _consistency(frames, track, inside)
            rows.append({"tracker": track.name, **shared, **accuracy, **consistency})
    table = pd.DataFrame(rows, columns=["tracker", "side", "markers", *ACCURACY, *CONSISTENCY])
    table["verdict"] = table["verdict"].fillna("")
    order = {name: i for i, name in enumerate(dict.fromkeys(table["tracker"]))}
    return table.sort_values(
        "tracker", key=lambda t: t.map(order), kind="stable", ignore_index=True
    )


def acceleration(time_s: Array, position_m: Array) -> Array:
    """(N - 2, 2) second differences over the real time steps: around the inner N - 2 positions.

    NaN where no time passes between two of the three.
    """
    step_s = np.diff(time_s)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.diff(position_m, axis=0) / step_s
        result = np.diff(velocity, axis=0) / ((step_s[1:] + step_s[:-1]) / 2.0)
    result[~np.isfinite(result).all(axis=1)] = np.nan
    return np.asarray(result, dtype=np.float64)


def acceleration_rms(time_s: Array, position_m: Array, inside: npt.NDArray[np.bool_]) -> float:
    """RMS acceleration, m/s², of the positions that are `inside`; NaN with too few.

    Only from `SETTLED_S` after the first known position on. All three positions of a second
    difference are inside: what happens from one side to the next is neither's.
    """
    known = np.isfinite(position_m).all(axis=1)
    if known.any():
        known &= time_s >= time_s[known][0] + SETTLED_S
    here = inside[known]
    values = acceleration(time_s[known], position_m[known])
    values = values[here[:-2] & here[1:-1] & here[2:]]
    values = values[np.isfinite(values).all(axis=1)]
    return float(np.sqrt((values**2).sum(axis=1).mean())) if len(values) >= MIN_COUNT else np.nan


def _accuracy(
    drive: Drive, frames: Timeline, position_m: Array, inside: npt.NDArray[np.bool_]
) -> Row:
    known = inside & np.isfinite(position_m).all(axis=1)
    row: Row = {"frames": int(known.sum())}
    if frames.exact_m is not None:
        error_m = (position_m - frames.exact_m)[known]
        error_m = error_m[np.isfinite(error_m).all(axis=1)]
        if len(error_m) >= MIN_COUNT:
            x2, y2 = (error_m**2).mean(axis=0).tolist()
            row["rmse_x_cm"], row["rmse_y_cm"] = 100.0 * x2**0.5, 100.0 * y2**0.5
            row["rmse_position_cm"] = 100.0 * (x2 + y2) ** 0.5
    if drive.path is not None and known.sum() >= MIN_COUNT:
        path = path_errors(position_m[known], drive.path)
        row["path_rms_cm"], row["path_max_cm"] = 100.0 * path["rms_m"], 100.0 * path["max_m"]
        row["in_band_percent"] = 100.0 * path["share_in_band"]
    row["accel_rms_cmps2"] = 100.0 * acceleration_rms(frames.time_s, position_m, inside)
    return row


def _consistency(frames: Timeline, track: Track, inside: npt.NDArray[np.bool_]) -> Row:
    updates = np.isfinite(track.nis)
    here = updates & inside
    row: Row = {"updates": int(here.sum())}
    if here.sum() >= MIN_COUNT:
        test = nis_test(track.nis[here])
        row |= {"nis_mean": test.mean, "nis_low": test.low, "nis_high": test.high}
        row["verdict"] = test.verdict
        innovation, variance = track.innovation_m[here], track.innovation_var_m2[here]
        row["log_likelihood"] = float(log_likelihood(innovation, variance).mean())
        row["lag1_x"], row["lag1_y"] = lag1(innovation, variance).tolist()
        row["lag1_band"] = lag1_band(len(innovation) - 1)
    if frames.exact_m is not None:
        values = nees(track.position_m - frames.exact_m, track.variance_m2)[inside]
        values = values[np.isfinite(values)]
        if len(values) >= MIN_COUNT:
            row["nees_mean"] = float(values.mean())
    return row
