"""The study's tables in sentences: which tracker is best, and which is wrong about itself."""

from __future__ import annotations

from typing import Any

import pandas as pd

from analysis.tracking.statistics import ALL
from replay.accuracy import FIXES

_Row = dict[str, Any]


def findings(table: pd.DataFrame) -> tuple[str, ...]:
    """Sentences about one drive, from its `tracking_table`."""
    trackers = table[table["tracker"] != FIXES]
    rows = [{str(key): value for key, value in row.items()} for row in trackers.to_dict("records")]
    sentences = [
        *_best(rows, "rmse_position_cm", "nearest to the exact truth", "RMSE {:.2f} cm"),
        *_best(rows, "path_rms_cm", "nearest to the measured path", "rms {:.2f} cm"),
        *_best(rows, "accel_rms_cmps2", "smoothest", "RMS acceleration {:.2f} cm/s²"),
        *_best(rows, "log_likelihood", "most likely", "{:.2f} nats an update", largest=True),
    ]
    for name in dict.fromkeys(row["tracker"] for row in rows):
        sentences += _consistency(name, [row for row in rows if row["tracker"] == name])
    return tuple(sentences)


def _best(
    rows: list[_Row], column: str, what: str, amount: str, *, largest: bool = False
) -> list[str]:
    """Which tracker is best in a column: over the whole drive, then where another is."""
    by_side: dict[str, list[_Row]] = {}
    for row in rows:
        if row[column] == row[column]:
            by_side.setdefault(row["side"], []).append(row)
    if len(by_side.get(ALL, [])) < 2:
        return []
    pick = max if largest else min
    best = {side: pick(there, key=lambda r: r[column]) for side, there in by_side.items()}
    winner = best.pop(ALL)
    name = winner["tracker"]
    sentence = f"Over the whole drive {name} is {what} ({amount.format(winner[column])})"
    others = []
    for side, row in best.items():
        own = next(r[column] for r in by_side[side] if r["tracker"] == name)
        # What two decimals do not tell apart is the same.
        if row["tracker"] != name and abs(own - row[column]) >= 0.01:
            others.append(f"on side {side} {row['tracker']} is ({amount.format(row[column])})")
    return [f"{sentence}; {', '.join(others)}." if others else f"{sentence}."]


def _consistency(name: str, rows: list[_Row]) -> list[str]:
    """Whether the tracker is over- or underconfident, and where."""
    whole = next((row for row in rows if row["side"] == ALL), None)
    if whole is None or not whole["verdict"]:
        return []
    by_verdict: dict[str, list[str]] = {}
    for row in rows:
        if row["side"] != ALL and row["verdict"]:
            place = f"{row['side']}: {row['nis_mean']:.2f}"
            by_verdict.setdefault(row["verdict"], []).append(place)
    average = " on average" if by_verdict and whole["verdict"] not in by_verdict else ""
    sentence = (
        f"{name} is {whole['verdict']}{average}: mean NIS {whole['nis_mean']:.2f}, expected "
        f"{whole['nis_low']:.2f} to {whole['nis_high']:.2f} (n = {int(whole['updates'])})"
    )
    if by_verdict:
        parts = [f"{verdict} on {_listed(sides)}" for verdict, sides in by_verdict.items()]
        sentence += f"; {', '.join(parts)}"
    nees = whole["nees_mean"]
    if nees == nees:
        sentence += (
            f". Its position is off by {(nees / 2.0) ** 0.5:.1f} times what its covariance says "
            f"(mean NEES {nees:.1f}, 2 expected)"
        )
    lags = [lag for lag in (whole["lag1_x"], whole["lag1_y"]) if lag == lag]
    lag = max(lags, key=abs, default=0.0)
    if abs(lag) > whole["lag1_band"]:
        # A gain that is too small leaves errors of one sign, one that is too large overshoots.
        why = (
            "it lags behind, or the fixes share a bias"
            if lag > 0
            else "it follows the fixes' noise"
        )
        sentence += (
            f". Its innovations are not white: {why} (autocorrelation {lag:+.2f}, "
            f"±{whole['lag1_band']:.2f} expected)"
        )
    return [sentence + "."]


def _listed(sides: list[str]) -> str:
    word = "side" if len(sides) == 1 else "sides"
    return f"{word} {', '.join(sides)}"
