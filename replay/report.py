"""A replay's summary as text for a person."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def summary_text(folder: Path, summary: dict[str, Any]) -> str:
    """Some lines: frames by status, speed, errors of the fixes and each tracker, where it lies."""
    frames = summary["frames"]
    status = ", ".join(f"{n} {name}" for name, n in by_count(summary["status"]))
    lines = [
        f"{summary['log']}: {frames} frames in {summary['duration_s']:.1f} s of the log: {status}; "
        f"{summary['frames_per_second']:.0f} frames/s"
    ]
    if summary["fallback"]:
        lines.append(
            f"  RANSAC failed and the plain solver was used in {summary['fallback']} frames"
        )
    for kind, trackers in summary["errors"].items():
        for name, error in trackers.items():
            text = _path(error) if kind == "path" else _timed(error)
            lines.append(f"  {name:>12} against {kind:<8} {text}")
    lines.append(f"  {folder}")
    return "\n".join(lines)


def by_count(status: dict[str, int]) -> list[tuple[str, int]]:
    """The most frequent first."""
    return [(name, n) for name, n in sorted(status.items(), key=lambda item: (-item[1], item[0]))]


def _timed(error: dict[str, Any]) -> str:
    if not error["n"]:
        return "no frames"
    x, y, position = error["x_m"], error["y_m"], error["position_m"]
    return (
        f"rmse x {100 * x['rmse']:.2f} y {100 * y['rmse']:.2f} cm, "
        f"median {100 * position['median']:.2f} cm, max {100 * position['max']:.2f} cm "
        f"({error['n']} frames)"
    )


def _path(error: dict[str, Any]) -> str:
    if not error["n"]:
        return "no frames"
    return (
        f"rms {100 * error['rms_m']:.2f} cm, max {100 * error['max_m']:.2f} cm, "
        f"{100 * error['share_in_band']:.1f} % within ±{100 * error['band_m']:.0f} cm "
        f"({error['n']} frames)"
    )
