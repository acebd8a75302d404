"""Repeats of one drive as one table: what a single run cannot say, because its errors depend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import stats

from analysis.tracking.consistency import CONFIDENCE, DOF, lag1_band, nis_verdict
from analysis.tracking.statistics import ACCURACY, CONSISTENCY
from pipeline.geometry import Array

_ROOT_MEAN_SQUARE = (
    "rmse_x_cm",
    "rmse_y_cm",
    "rmse_position_cm",
    "path_rms_cm",
    "accel_rms_cmps2",
)
_OF_UPDATES = ("nis_mean", "log_likelihood")
_SUMS = ("frames", "updates")
_KEYS = ["tracker", "side"]


def pool(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """One `drive_table` of several of the same drive, each with other noise.

    RMS columns are pooled as such, counts added, the largest distance to the path is that of all,
    means of updates are those of all updates, everything else is the mean over the repeats. The
    band of the mean NIS is that of all updates together. A cell that is empty in one repeat is
    empty.

    Raises:
        ValueError: the tables' trackers or sides differ.
    """
    head = tables[0][_KEYS]
    if any(not table[_KEYS].equals(head) for table in tables):
        raise ValueError("expected repeats of one drive, found other trackers or sides")
    numbers = [c for c in ("markers", *ACCURACY, *CONSISTENCY) if c != "verdict"]
    stacked = np.stack([table[numbers].to_numpy(dtype=np.float64) for table in tables])
    pooled = pd.DataFrame(stacked.mean(axis=0), columns=numbers)
    squared = pd.DataFrame((stacked**2).mean(axis=0) ** 0.5, columns=numbers)
    total = pd.DataFrame(stacked.sum(axis=0), columns=numbers)
    for column in _ROOT_MEAN_SQUARE:
        pooled[column] = squared[column]
    for column in _SUMS:
        pooled[column] = total[column]
    weights = stacked[:, :, numbers.index("updates")]
    for column in _OF_UPDATES:
        weighted = (stacked[:, :, numbers.index(column)] * weights).sum(axis=0)
        pooled[column] = weighted / total["updates"]
    at = numbers.index("path_max_cm")
    pooled["path_max_cm"] = stacked[:, :, at].max(axis=0)
    updates = pooled["updates"]
    tail = (1.0 - CONFIDENCE) / 2.0
    pooled["nis_low"] = stats.chi2.ppf(tail, updates * DOF) / updates
    pooled["nis_high"] = stats.chi2.ppf(1.0 - tail, updates * DOF) / updates
    pooled["lag1_band"] = [lag1_band(n) if n > 0 else np.nan for n in updates - len(tables)]
    pooled["verdict"] = [
        nis_verdict(mean, low, high) if mean == mean else ""
        for mean, low, high in zip(
            pooled["nis_mean"], pooled["nis_low"], pooled["nis_high"], strict=True
        )
    ]
    return pd.concat([head, pooled[["markers", *ACCURACY, *CONSISTENCY]]], axis="columns")


def nees_in_band(nees: Sequence[Array]) -> float:
    """The share of moments at which the mean NEES of the repeats is inside its 95 % band.

    Near 0.95 for a filter whose covariance is true at every moment; NaN without a moment that all
    know. Repeats with independent noise are what a band of NEES needs.

    Args:
        nees: of each repeat (N,), the same moments in each.

    Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2, the N-run average.
    """
    mean = np.mean(nees, axis=0)
    mean = mean[np.isfinite(mean)]
    if not len(mean):
        return float("nan")
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = stats.chi2.ppf([tail, 1.0 - tail], len(nees) * DOF) / len(nees)
    return float(((mean >= low) & (mean <= high)).mean())
