"""The drive from above, as in the paper, and each tracker's consistency side by side."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from analysis.style import FAINT, SHAPES, TRUTH_COLOUR, WIDE, new_figure, tracker_colours
from analysis.tracking.drive import Drive, Timeline, Track, timeline, tracks_of
from analysis.tracking.statistics import ALL
from pipeline.geometry import Array
from recorder.files.truth_file import TruthPath
from replay.accuracy import FIXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Around what is to be seen, metres.
MARGIN_M = 0.4
# Fixes and tracks further than this from a side do not widen the view of it.
REACH_M = 1.0
_BAND_COLOUR = "#d0d0d0"
_LONG_EDGE_IN = 8.5


def trajectory_figure(drive: Drive, side: int | None = None) -> tuple[Figure, int]:
    """Fixes, measured path, exact truth and trackers, whole or around one side of the path.

    Args:
        side: its position among the sides, from 0.

    Returns:
        The figure, and how many of the fixes lie outside of it.
    """
    from matplotlib.patheffects import Normal, Stroke

    frames, tracks = timeline(drive), tracks_of(drive)
    low, high = _view(drive, frames, tracks, side)
    figure = new_figure(_size(high - low))
    axes = figure.add_subplot()
    if drive.path is not None:
        _draw_path(axes, drive.path)
    here = frames.side == side if side is not None else np.ones(len(frames.side), dtype=np.bool_)
    fixes = frames.fix_m[here & np.isfinite(frames.fix_m).all(axis=1)]
    axes.plot(*fixes.T, ".", color=TRUTH_COLOUR, markersize=2.5, label=FIXES, zorder=2)
    if frames.exact_m is not None:
        axes.plot(
            *frames.exact_m.T, "--", color="#606060", linewidth=0.9, label="exact truth", zorder=5
        )
    colours = tracker_colours(track.name for track in tracks)
    # The first is the one of interest: on top.
    for depth, track in enumerate(tracks):
        (line,) = axes.plot(
            *track.position_m.T,
            color=colours[track.name],
            linewidth=1.8 if depth == 0 else 1.3,
            label=track.name,
            zorder=4 - depth / len(tracks),
        )
        # Pale colours need an edge on white.
        line.set_path_effects([Stroke(linewidth=2.5, foreground="#505050"), Normal()])
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x in m", ylabel="y in m")
    axes.set_aspect("equal")
    # A column takes an inch and a half.
    columns = max(2, int(figure.get_figwidth() / 1.6))
    figure.legend(loc="outside lower center", ncols=min(4, columns), markerscale=2.5)
    outside = int(((fixes < low) | (fixes > high)).any(axis=1).sum())
    return figure, outside


def consistency_figure(table: pd.DataFrame) -> Figure:
    """Mean NIS of each tracker by side with its band and, with exact truth, mean NEES."""
    rows = table[table["tracker"] != FIXES]
    panels = [("nis_mean", "mean NIS, of the fixes")]
    if rows["nees_mean"].notna().any():
        panels.append(("nees_mean", "mean NEES, of the position"))
    names, sides = list(dict.fromkeys(rows["tracker"])), list(dict.fromkeys(rows["side"]))
    figure = new_figure((WIDE[0], WIDE[1] if len(panels) == 1 else 4.4))
    for axes, (column, label) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
    ):
        _by_side(axes, rows, column, names, sides)
        axes.axhline(2.0, color=TRUTH_COLOUR, linewidth=0.8, linestyle=":")
        axes.set_yscale("log")
        axes.set_xticks(
            range(len(sides)), ["all" if s == ALL else s.replace(" (", "\n(") for s in sides]
        )
        axes.set(xlabel="side", title=f"{label} (2 where the model is true)")
        axes.title.set_fontsize(10)
    for position, side in enumerate(sides):
        low, high = rows[rows["side"] == side][["nis_low", "nis_high"]].max().tolist()
        if np.isfinite(low):
            ends = [position - 0.45, position + 0.45]
            figure.axes[0].fill_between(ends, low, high, color=FAINT, alpha=0.6, linewidth=0)
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=5)
    return figure


def _by_side(
    axes: Axes, rows: pd.DataFrame, column: str, names: list[str], sides: list[str]
) -> None:
    colours = tracker_colours(names)
    for i, name in enumerate(names):
        mean = rows[rows["tracker"] == name].set_index("side")[column].reindex(sides)
        offset = 0.6 * ((i + 0.5) / len(names) - 0.5)
        axes.plot(
            np.arange(len(sides)) + offset,
            mean.to_numpy(dtype=np.float64),
            SHAPES[i % len(SHAPES)],
            color=colours[name],
            markeredgecolor="#505050",
            markersize=8,
            label=name,
        )


def _view(
    drive: Drive, frames: Timeline, tracks: list[Track], side: int | None
) -> tuple[Array, Array]:
    """Lower left and upper right of what is shown: the path and what is said of the camera."""
    if side is not None:
        here, corners = frames.side == side, frames.sides[side].points_m
        near = [position_m[here] for position_m in (frames.fix_m, *(t.position_m for t in tracks))]
        low, high = corners.min(axis=0) - REACH_M, corners.max(axis=0) + REACH_M
        shown = [corners, *(np.clip(position_m, low, high) for position_m in near)]
    elif drive.path is not None:
        shown = [drive.path.points_m]
    else:
        shown = [track.position_m for track in tracks]
        shown += [] if frames.exact_m is None else [frames.exact_m]
    points = np.concatenate(shown)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        points = np.zeros((1, 2))
    margin_m = MARGIN_M if side is None else MARGIN_M / 4
    return points.min(axis=0) - margin_m, points.max(axis=0) + margin_m


def _size(extent_m: Array) -> tuple[float, float]:
    """Inches for an equal aspect with a legend below."""
    width, height = (_LONG_EDGE_IN * extent_m / extent_m.max()).tolist()
    return max(width, 4.0), max(height, 2.0) + 0.8


def _draw_path(axes: Axes, path: TruthPath) -> None:
    """The measured path with a rectangle of ± its uncertainty around each segment."""
    from matplotlib.patches import Polygon

    points = list(path.points_m) + ([path.points_m[0]] if path.closed else [])
    label = f"measured, ±{100.0 * path.std_m:g} cm"
    for i, (start, end) in enumerate(pairwise(points)):
        length = float(np.hypot(*(end - start)))
        ahead = (end - start) / length if length else np.array([1.0, 0.0])
        aside = np.array([-ahead[1], ahead[0]])
        a, b = start - ahead * path.std_m, end + ahead * path.std_m
        corners = [a - aside * path.std_m, a + aside * path.std_m]
        corners += [b + aside * path.std_m, b - aside * path.std_m]
        axes.add_patch(
            Polygon(
                np.array(corners),
                closed=True,
                facecolor=_BAND_COLOUR,
                edgecolor="none",
                zorder=1,
                label=label if i == 0 else None,
            )
        )
