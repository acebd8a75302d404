"""The filters' errors, smoothness and consistency at each speed, over the seeds."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from analysis.paper.configuration_two import SIDE_NAMES, Outcome
from analysis.paper.experiments import SPEEDS_MPS, Experiments
from analysis.study import StudyTable
from analysis.tracking.findings import findings
from analysis.tracking.pool import nees_in_band, pool
from analysis.tracking.statistics import ALL
from replay.accuracy import FIXES

# Columns of the study as the page heads them.
_ACCURACY = {
    "rmse_x_cm": "RMSE x cm",
    "rmse_y_cm": "RMSE y cm",
    "rmse_position_cm": "RMSE cm",
    "path_rms_cm": "to path cm",
    "in_band_percent": "in ±5 cm %",
    "accel_rms_cmps2": "accel. cm/s²",
}
_CONSISTENCY = {
    "nis_mean": "mean NIS",
    "nis_low": "band from",
    "nis_high": "to",
    "verdict": "verdict",
    "nees_mean": "mean NEES",
    "lag1_x": "lag-1 x",
    "lag1_y": "lag-1 y",
    "lag1_band": "white within ±",
    "log_likelihood": "log-likelihood",
}
_BY_SIDE = _ACCURACY | {
    key: _CONSISTENCY[key] for key in ("nis_mean", "verdict", "nees_mean", "lag1_x", "lag1_y")
}


def tracking_tables(runs: Experiments) -> list[StudyTable]:
    """At each speed: over the whole drive, consistency, by side."""
    return [table for speed in runs.drives for table in _tables(runs.drives[speed], speed)]


def consistency_sentences(runs: Experiments) -> tuple[str, ...]:
    """Which filter is best in what, which is overconfident, and where; of the slowest drive."""
    return findings(_pooled(runs.drives[SPEEDS_MPS[0]]))


def _pooled(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    table = pool([outcome.table for outcome in outcomes])
    return table.assign(side=[SIDE_NAMES.get(side, side) for side in table["side"]])


def _tables(outcomes: Sequence[Outcome], speed_mps: float) -> list[StudyTable]:
    table, name = _pooled(outcomes), f"{speed_mps:g}".replace(".", "_")
    whole, sides = table[table["side"] == ALL], table[table["side"] != ALL]
    filters = whole[whole["tracker"] != FIXES]
    shares = [
        100.0 * nees_in_band([outcome.nees[tracker] for outcome in outcomes])
        for tracker in filters["tracker"]
    ]
    return [
        StudyTable(
            f"tracking_{name}",
            f"The filters at {speed_mps:g} m/s",
            whole[["tracker", *_ACCURACY]].rename(columns=_ACCURACY),
            (
                f"Over {len(outcomes)} seeds. `fitted`: the same models with our variances and "
                "R = σ² (the paper's filters have R = σ²/4, as `…-quarter` has). RMSE is against "
                "the exact pose, "
                "distances are to the exact path. Accelerations are from 2 s after the start on: "
                "before, a track jumps to its first fixes; over the whole drive they are those of "
                "the side with one marker.",
            ),
        ),
        StudyTable(
            f"consistency_{name}",
            f"Consistency at {speed_mps:g} m/s",
            filters[["tracker", *_CONSISTENCY]]
            .rename(columns=_CONSISTENCY)
            .assign(**{"NEES in band %": shares}),
            (
                "The band is that of a mean NIS, chi-square with two degrees of freedom an update, "
                "95 %, of all updates of all seeds. Mean NEES: of the position, 2 expected; in "
                f"band: the share of moments at which the mean over the {len(outcomes)} seeds is "
                "within its 95 % band. The verdict is about the fixes, by the NIS: an error that "
                "all fixes share shows in the NEES only. Lag-1 over the whole drive is that of the "
                "innovations that are largest against their σ; by side it is below. "
                "Log-likelihood: of the innovations, nats an update.",
            ),
        ),
        StudyTable(
            f"tracking_by_side_{name}",
            f"The filters at {speed_mps:g} m/s, by side",
            sides[["tracker", "side", *_BY_SIDE]].rename(columns=_BY_SIDE),
            ("At most 1, 3, 5 and all markers on the top, left, bottom and right side.",),
            digits=1,
        ),
    ]
