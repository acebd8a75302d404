"""Results side by side: the settings that differ, and the errors."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from recorder.errors import InputError
from replay.accuracy import FIXES
from replay.result import Result, open_result

# Settings of more characters would push the errors out of sight.
_LONG = 32


def compare(folders: Sequence[Path]) -> pd.DataFrame:
    """One row per result and tracker, and one for the raw fixes.

    Columns: `result`, `tracker`, each setting that is not the same in all rows, `frames`, `ok`
    (share of frames with a pose), then errors in cm by kind of truth; those that no result has
    are absent.

    Raises:
        InputError: a folder is no result, or results are of different logs.
    """
    results = [open_result(folder) for folder in folders]
    for result in results[1:]:
        if result.summary["log_sha256"] != results[0].summary["log_sha256"]:
            raise InputError(
                result.folder,
                f"expected a result of {results[0].summary['log']} like {results[0].folder}, "
                f"found one of {result.summary['log']}",
            )
    rows: list[dict[str, Any]] = []
    settings: list[dict[str, Any]] = []
    for result, name in zip(results, _unique_names(results), strict=True):
        for tracker in (FIXES, *result.settings.trackers):
            rows.append({"result": name, "tracker": tracker, **_figures(result, tracker)})
            settings.append(_settings(result, tracker))
    table = pd.DataFrame(rows)
    for position, (key, values) in enumerate(_differing(settings).items()):
        table.insert(2 + position, key, pd.Series(values, dtype=object))
    if table["result"].nunique() == 1:
        table = table.drop(columns="result")
    return table.dropna(axis="columns", how="all")


def _unique_names(results: Sequence[Result]) -> list[str]:
    names = [result.name for result in results]
    if len(set(names)) < len(names):
        names = [str(result.folder) for result in results]
    if len(set(names)) < len(names):
        raise InputError(results[0].folder, "expected each result once, found it again")
    return names


def _figures(result: Result, tracker: str) -> dict[str, Any]:
    summary = result.summary
    row: dict[str, Any] = {
        "frames": summary["frames"],
        "ok %": 100.0 * summary["status"].get("ok", 0) / summary["frames"],
    }
    errors = summary["errors"]
    for kind in ("exact", "measured"):
        error = errors.get(kind, {}).get(tracker)
        if error is not None and error["n"]:
            row[f"{kind} rmse x cm"] = 100.0 * error["x_m"]["rmse"]
            row[f"{kind} rmse y cm"] = 100.0 * error["y_m"]["rmse"]
            row[f"{kind} max cm"] = 100.0 * error["position_m"]["max"]
    error = errors.get("path", {}).get(tracker)
    if error is not None and error["n"]:
        row["path rms cm"] = 100.0 * error["rms_m"]
        row["path max cm"] = 100.0 * error["max_m"]
        row[f"% in ±{100.0 * error['band_m']:g} cm"] = 100.0 * error["share_in_band"]
    return row


def _settings(result: Result, tracker: str) -> dict[str, Any]:
    """The settings that this row depends on, flat: `pose.max_markers`, `variance.kind`."""
    whole = result.settings.model_dump(mode="json")
    flat = _flat({"detector": whole["detector"], "pose": whole["pose"]})
    if tracker != FIXES:
        flat |= _flat(whole["trackers"][tracker])
    for key in ("from_s", "to_s"):
        flat[key] = result.summary[key]
    # Another calibration or map is another replay, whatever the file is called.
    for file, sha256 in result.summary["inputs"].items():
        flat[file] = sha256[:8]
    return flat


def _flat(tree: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def _differing(rows: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Settings that differ between the rows that have them; `-` where one has none or null."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    columns = {
        key: ["-" if row.get(key) is None else _short(row[key]) for row in rows] for key in keys
    }
    differing = {}
    for key, values in columns.items():
        asked = {value for value, row in zip(values, rows, strict=True) if key in row}
        if len(asked) > 1:
            differing[key] = values
    return differing


def _short(value: Any) -> str:
    """A setting; a long one by its beginning and a digest that tells it from others."""
    text = str(value)
    if len(text) <= _LONG:
        return text
    return f"{text[: _LONG - 8]}… {hashlib.sha256(text.encode()).hexdigest()[:6]}"


def as_text(table: pd.DataFrame) -> str:
    """The table for a terminal."""
    return table.to_string(index=False, float_format=lambda value: f"{value:.2f}", na_rep="-")
