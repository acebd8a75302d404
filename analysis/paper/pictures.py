"""The figures of the page."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.paper.configuration_one import CountErrors
from analysis.paper.configuration_two import BAND_M, SETTLED_S, SIDES, Drive
from analysis.paper.experiments import Experiments
from analysis.paper.findings import of_class
from analysis.paper.references import CLASSES
from analysis.study import StudyFigure
from analysis.style import PALETTE, SHAPES, WIDE, new_figure, tracker_colours
from pipeline.geometry import Array


def all_pictures(runs: Experiments) -> list[StudyFigure]:
    """Placement, numbers of markers, trajectories."""
    slow = runs.drives[min(runs.drives)][0]
    return [placement(runs), counts(runs), trajectories(slow), trajectories(slow, 0)]


def placement(runs: Experiments) -> StudyFigure:
    """The errors of single markers in x and y, by class, at both heights."""
    figure = new_figure((WIDE[0], 4.6))
    panels = figure.subplots(1, 2)
    for axis, (name, stands, title, limit) in zip(
        panels,
        (
            ("configuration_1_low", runs.low, "1.334 m", 15.0),
            ("configuration_1_high", runs.high, "2.991 m", 100.0),
        ),
        strict=True,
    ):
        outside = 0
        for (label, _), colour, shape in zip(
            list(CLASSES.items())[1:], PALETTE, SHAPES, strict=False
        ):
            xy = (
                100.0
                * np.concatenate([of_class(runs.sites[name], s, label) for s in stands])[:, :2]
            )
            outside += int((np.abs(xy) > limit).any(axis=1).sum())
            axis.plot(*xy.T, shape, color=colour, markersize=3.5, alpha=0.6, label=label)
        axis.set(
            title=f"{title} ({outside} outside)",
            xlabel="error in x (cm)",
            ylabel="error in y (cm)",
            xlim=(-limit, limit),
            ylim=(-limit, limit),
            aspect="equal",
        )
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return StudyFigure(
        "placement",
        "Single markers, by class and height",
        figure,
        f"One mark for each marker of each of {len(runs.low)} seeds.",
    )


def counts(runs: Experiments) -> StudyFigure:
    """RMSE, largest error and mean error by number of markers, over the seeds."""
    figure = new_figure((WIDE[0], 4.2))
    panels = figure.subplots(1, 3)
    numbers = sorted(runs.high[0].counts)
    kinds: dict[str, Callable[[CountErrors], float]] = {
        "RMSE": lambda c: _norm(c.rmse),
        "largest error": lambda c: c.max_m,
        "size of the mean error": lambda c: _norm(c.mean),
    }
    solvers = {"the paper's solver": "counts", "batch": "batch"}
    for axis, (title, value) in zip(panels, kinds.items(), strict=True):
        for (label, key), colour, shape in zip(solvers.items(), PALETTE, SHAPES, strict=False):
            cm = 100.0 * np.array([[value(getattr(s, key)[n]) for n in numbers] for s in runs.high])
            axis.plot(numbers, cm.T, color=colour, alpha=0.2, linewidth=0.7)
            axis.plot(
                numbers,
                np.median(cm, axis=0),
                f"{shape}-",
                color=colour,
                linewidth=2.0,
                markersize=5,
                label=label,
            )
        axis.set(title=title, xlabel="markers", ylabel="cm", yscale="log", xticks=numbers)
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("{x:g}")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return StudyFigure(
        "count",
        "By number of markers at 2.991 m",
        figure,
        "Subsets of one to seven of the 24 markers (the paper's solver: a random sample of those "
        "of six and seven); a thin line for each seed, the median thick.",
    )


def trajectories(drive: Drive, side: int | None = None) -> StudyFigure:
    """The five filters over the fixes and the measured path, whole or around one side."""
    from matplotlib.patheffects import Normal, Stroke

    names = [name for name in drive.tracks_m if " " not in name]
    figure = new_figure((WIDE[0], 6.0 if side is None else 4.0))
    axis = figure.add_subplot()
    corners = np.vstack([drive.path.points_m, drive.path.points_m[:1]])
    axis.plot(*corners.T, color="#c8c8c8", linewidth=1.0, zorder=1)
    for sign in (-1.0, 1.0):
        axis.plot(*_offset(drive.path.points_m, sign * BAND_M).T, color="#8c8c8c", linewidth=0.8)
    shown = np.ones(len(drive.side), bool) if side is None else drive.side == side
    axis.plot(*drive.fixes_m[shown].T, ".", color="black", markersize=2.0, label="fixes", zorder=2)
    for i, (name, colour) in enumerate(tracker_colours(names).items()):
        (line,) = axis.plot(
            *drive.tracks_m[name][shown].T, color=colour, linewidth=1.5, label=name, zorder=9 - i
        )
        # Pale colours need an edge on white.
        line.set_path_effects([Stroke(linewidth=2.2, foreground="#505050"), Normal()])
    low, high = drive.path.points_m.min(axis=0), drive.path.points_m.max(axis=0)
    if side is not None:
        # All that the filters make of it, from when they have settled.
        settled = shown & (drive.time_s >= SETTLED_S)
        tracks = np.concatenate([drive.tracks_m[name][settled] for name in names])
        low, high = tracks.min(axis=0), tracks.max(axis=0)
    margin = 0.35 if side is None else 0.05
    axis.set(
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[1] - margin, high[1] + margin),
        xlabel="x (m)",
        ylabel="y (m)",
        aspect="equal",
    )
    figure.legend(loc="outside lower center", ncols=6, markerscale=4)
    where = "whole" if side is None else f"{SIDES[side]} side, one marker"
    return StudyFigure(
        "trajectories" if side is None else f"trajectories_{SIDES[side]}",
        f"The filters at 0.05 m/s: {where}",
        figure,
        "The first seed. Grey lines: the path and its ±5 cm; fixes beyond the frame are not shown.",
    )


def _offset(corners_m: Array, by_m: float) -> Array:
    """A rectangle (4, 2) grown by `by_m` on every side, closed."""
    centre = corners_m.mean(axis=0)
    grown = corners_m + np.sign(corners_m - centre) * by_m
    return np.vstack([grown, grown[:1]])


def _norm(values: Array) -> float:
    return float(np.hypot(values[0], values[1]))
