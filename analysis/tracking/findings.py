"""The study's tables in sentences: which tracker is best, and which is wrong about itself."""

from __future__ import annotations

from typing import Any

import pandas as pd

from analysis.tracking.statistics import ALL
from replay.accuracy import FIXES

_Row = dict[str, Any]


def findings(table: pd.DataFrame) -> tuple[str, ...]:
    """Sentences about one drive, from its `drive_table`."""
    everything = [{str(k): value for k, value in row.items()} for row in table.to_dict("records")]
    rows = [row for row in everything if row["tracker"] != FIXES]
    fixes = {row["side"]: row for row in everything if row["tracker"] == FIXES}
    sentences = [
        *_best(rows, "rmse_position_cm", "nearest to the exact truth", "RMSE {:.2f} cm"),
        *_unfiltered(rows, fixes, "rmse_position_cm"),
        *_best(rows, "path_rms_cm", "nearest to the measured path", "rms {:.2f} cm"),
        *_unfiltered(rows, fixes, "path_rms_cm"),
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


def _unfiltered(rows: list[_Row], fixes: dict[str, _Row], column: str) -> list[str]:
    """Where the fixes themselves are nearer than every tracker."""
    places = []
    for side, fix in fixes.items():
        of_trackers = [row[column] for row in rows if row["side"] == side]
        if of_trackers and fix[column] < min(of_trackers) - 0.005:
            where = "over the whole drive" if side == ALL else f"on side {side}"
            places.append(f"{where} ({fix[column]:.2f} cm)")
    return [f"The fixes themselves are nearer still {', '.join(places)}."] if places else []


def _consistency(name: str, rows: list[_Row]) -> list[str]:
    """What the innovations say of the tracker's covariance, and what the exact truth says."""
    whole = next((row for row in rows if row["side"] == ALL), None)
    if whole is None or not whole["verdict"]:
        return []
    sides = [row for row in rows if row["side"] != ALL]
    by_verdict: dict[str, list[str]] = {}
    for row in sides:
        if row["verdict"]:
            by_verdict.setdefault(row["verdict"], []).append(
                f"{row['side']}: {row['nis_mean']:.2f}"
            )
    average = " on average" if by_verdict and whole["verdict"] not in by_verdict else ""
    sentence = (
        f"{name} is {whole['verdict']}{average} about its fixes: mean NIS {whole['nis_mean']:.2f}, "
        f"expected {whole['nis_low']:.2f} to {whole['nis_high']:.2f} "
        f"(n = {int(whole['updates'])})"
    )
    if by_verdict:
        parts = [f"{verdict} on {_listed(places)}" for verdict, places in by_verdict.items()]
        sentence += f"; {', '.join(parts)}"
    return [sentence + _position(whole, sides) + _whiteness(whole) + "."]


def _position(whole: _Row, sides: list[_Row]) -> str:
    """By the exact truth, which also sees an error that all fixes share; innovations do not."""
    nees = whole["nees_mean"]
    if nees != nees:
        return ""
    text = (
        f". About its position it is {_sureness(nees)}: errors are {_times(nees):.1f} times what "
        f"its covariance says (mean NEES {nees:.1f}, 2 expected)"
    )
    known = [row for row in sides if row["nees_mean"] == row["nees_mean"]]
    if len(known) > 1:
        worst, best = (f(known, key=lambda row: row["nees_mean"]) for f in (max, min))
        text += (
            f", most on side {worst['side']} ({_times(worst['nees_mean']):.1f} times), least on "
            f"side {best['side']} ({_times(best['nees_mean']):.1f})"
        )
    return text


def _whiteness(whole: _Row) -> str:
    lags = [lag for lag in (whole["lag1_x"], whole["lag1_y"]) if lag == lag]
    lag = max(lags, key=abs, default=0.0)
    if abs(lag) <= whole["lag1_band"]:
        return ""
    # A gain that is too small leaves errors of one sign, one that is too large overshoots.
    why = "it lags behind, or the fixes share a bias" if lag > 0 else "it follows the fixes' noise"
    return (
        f". Its innovations are not white: {why} (autocorrelation {lag:+.2f}, "
        f"±{whole['lag1_band']:.2f} expected)"
    )


def _times(nees: float) -> float:
    return float((nees / 2.0) ** 0.5)


def _sureness(nees: float) -> str:
    """In a word; one run's NEES has no band, so a fifth in size is let pass."""
    if _times(nees) > 1.2:
        return "overconfident"
    return "underconfident" if _times(nees) < 1 / 1.2 else "about right"


def _listed(sides: list[str]) -> str:
    word = "side" if len(sides) == 1 else "sides"
    return f"{word} {', '.join(sides)}"
