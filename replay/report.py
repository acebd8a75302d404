"""A replay's summary as text for a person."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from recorder.info_text import counted
from replay.accuracy import FIXES


def summary_text(folder: Path, summary: dict[str, Any]) -> str:
    """Some lines: frames by status, speed, errors of the fixes and each tracker, where it lies."""
    status = ", ".join(f"{n} {name}" for name, n in _by_count(summary["status"]))
    lines = [
        f"{summary['log']}: {summary['frames']} frames, {summary['duration_s']:.1f} s: {status} "
        f"({summary['frames_per_second']:.0f} frames/s)"
    ]
    if summary["fallback"]:
        lines.append(f"  in {summary['fallback']} frames RANSAC failed: the plain solver was used")
    for kind, estimates in summary["errors"].items():
        if any(error["n"] for error in estimates.values()):
            lines += _table(kind, estimates)
    lines.append(f"  {folder}")
    return "\n".join(lines)


# What most often is behind a status that no frame escapes.
_HINTS = {
    "no_markers": "are the map's dictionary and `inverted` right?",
    "unknown_ids": "are these the markers of the map, of its dictionary?",
    "behind_markers": "does `facing` in the map fit (down on a ceiling), are corners in order?",
    "reprojection": "are the markers' places, sizes and the calibration right?",
    "undecodable": "are the images whole, and of the calibration's size? `arucolog verify` says",
}
# A filter this much worse than the fixes that it smooths does not follow its robot.
_LAGS = 1.5


def warnings(summary: dict[str, Any]) -> list[str]:
    """What a person should know before trusting the numbers, one line each."""
    found = []
    if summary["log_cut_short"]:
        found.append(str(summary["log_cut_short"]))
    if not summary["status"].get("ok"):
        status, _ = _by_count(summary["status"])[0]
        hint = _HINTS.get(status)
        found.append(f"no frame has a pose, most are {status}" + (f": {hint}" if hint else ""))
    elif undecodable := summary["status"].get("undecodable"):
        found.append(
            f"{counted(undecodable, 'image')} damaged or of another size, without a pose; "
            "`arucolog verify` says which"
        )
    if summary["truth_without_frames"]:
        found.append(
            "the truth says nothing about any frame: are its times those of the log "
            f"({summary['start_ns'] / 1e9:.3f} s to {summary['end_ns'] / 1e9:.3f} s)?"
        )
    found += summary.get("truth_problems", ())
    timed = summary["errors"].get("exact") or summary["errors"].get("measured") or {}
    fixes = timed.get(FIXES)
    if fixes and fixes["n"]:
        lagging = [
            name
            for name, error in timed.items()
            if error["n"] and error["position_m"]["rmse"] > _LAGS * fixes["position_m"]["rmse"]
        ]
        if lagging:
            found.append(
                f"further from the truth than the fixes they smooth: {', '.join(lagging)}; "
                "raise accel_std for a robot that brakes and turns faster than it says"
            )
    return found


def _by_count(status: dict[str, int]) -> list[tuple[str, int]]:
    """The most frequent first."""
    return sorted(status.items(), key=lambda item: (-item[1], item[0]))


def _table(kind: str, estimates: dict[str, dict[str, Any]]) -> list[str]:
    if kind == "path":
        band_cm = 100 * next(iter(estimates.values()))["band_m"]
        names = ["rms", "max", f"% in ±{band_cm:g} cm", "frames"]
        title = "distance to the measured path, cm"
    else:
        names = ["rmse x", "rmse y", "median", "max", "frames"]
        title = {
            "exact": "error against the exact poses, cm",
            "measured": "error against the measured poses, cm",
        }[kind]
    width = max(len(name) for name in names) + 2
    lines = [f"  {title}", " " * 14 + "".join(f"{name:>{width}}" for name in names)]
    for estimate, error in estimates.items():
        cells = _path_cells(error) if kind == "path" else _timed_cells(error)
        lines.append(f"  {estimate:<12}" + "".join(f"{cell:>{width}}" for cell in cells))
    return lines


def _timed_cells(error: dict[str, Any]) -> list[str]:
    if not error["n"]:
        return ["-"] * 4 + ["0"]
    x, y, position = error["x_m"], error["y_m"], error["position_m"]
    values = (x["rmse"], y["rmse"], position["median"], position["max"])
    return [f"{100 * value:.2f}" for value in values] + [str(error["n"])]


def _path_cells(error: dict[str, Any]) -> list[str]:
    if not error["n"]:
        return ["-"] * 3 + ["0"]
    distances = [f"{100 * error[key]:.2f}" for key in ("rms_m", "max_m")]
    return [*distances, f"{100 * error['share_in_band']:.1f}", str(error["n"])]
