"""The filters: where they go, how they compare, whether they know how wrong they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.paper.configuration_two import PAPER_FILTERS, SIDE_NAMES, SIDES, TOP
from analysis.paper.experiments import FITTED, SPEEDS_MPS, Experiments
from analysis.study import StudyFigure
from analysis.style import SHAPES, WIDE, new_figure, plain_log_scale, tracker_colours
from analysis.tracking.drive import Drive
from analysis.tracking.figures import consistency_figure, trajectory_figure
from analysis.tracking.pool import pool

_SLOW = SPEEDS_MPS[0]


def sides(runs: Experiments) -> StudyFigure:
    """Distance to the path, share in the band and acceleration of the filters by side."""
    table = pool([o.table for o in runs.drives[_SLOW]]).set_index(["tracker", "side"])
    figure = new_figure((WIDE[0], 4.0))
    colours = tracker_colours(PAPER_FILTERS)
    panels = figure.subplots(1, 3)
    for axes, (column, title) in zip(
        panels,
        (
            ("path_rms_cm", "distance to the path (cm, rms)"),
            ("in_band_percent", "within ±5 cm (%)"),
            ("accel_rms_cmps2", "RMS acceleration (cm/s²)"),
        ),
        strict=True,
    ):
        for i, name in enumerate(PAPER_FILTERS):
            axes.plot(
                range(len(SIDES)),
                [table.loc[(name, side), column] for side in SIDES],
                f"{SHAPES[i]}-",
                color=colours[name],
                markeredgecolor="#505050",
                label=name,
            )
        axes.set_xticks(range(len(SIDES)), ["1", "3", "5", "all"])
        axes.set(title=title, xlabel="markers at most")
        axes.title.set_fontsize(10)
    panels[2].set_yscale("log")
    plain_log_scale(panels[2].yaxis)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return StudyFigure(
        "sides",
        "The filters by side at 0.05 m/s",
        figure,
        f"Over {len(runs.drives[_SLOW])} seeds.",
    )


def trajectory(runs: Experiments) -> StudyFigure:
    """The five filters over the fixes and the measured path."""
    figure, outside = trajectory_figure(_drive(runs))
    return StudyFigure(
        "trajectory",
        "The filters at 0.05 m/s: the whole drive",
        figure,
        f"The first seed; {outside} fixes are further out.",
    )


def trajectory_top(runs: Experiments) -> StudyFigure:
    """The same around the side with a single marker."""
    figure, outside = trajectory_figure(_drive(runs), SIDES.index(TOP))
    return StudyFigure(
        "trajectory_top",
        "The filters at 0.05 m/s: the top side, one marker",
        figure,
        f"The first seed; {outside} fixes are further out.",
    )


def speeds(runs: Experiments) -> StudyFigure:
    """Position RMSE over the whole drive by speed, with the paper's and with our variances."""
    figure = new_figure((WIDE[0], 4.2))
    colours = tracker_colours(PAPER_FILTERS)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (prefix, title) in zip(
        panels, (("", "the paper's variances"), (FITTED, "ours, R = σ²")), strict=True
    ):
        for i, name in enumerate(PAPER_FILTERS):
            values = [
                np.median([o.value("rmse_position_cm", prefix + name) for o in outcomes])
                for outcomes in runs.drives.values()
            ]
            axes.plot(
                list(runs.drives),
                values,
                f"{SHAPES[i]}-",
                color=colours[name],
                markeredgecolor="#505050",
                label=name,
            )
        axes.set(title=title, xlabel="speed (m/s)", xscale="log", yscale="log")
        axes.set_xticks(list(runs.drives), [f"{speed:g}" for speed in runs.drives])
        axes.set_xticks([], minor=True)
        plain_log_scale(axes.yaxis)
    panels[0].set_ylabel("position RMSE (cm)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return StudyFigure(
        "speeds",
        "The filters over the whole drive, by speed",
        figure,
        f"Median over {len(runs.drives[_SLOW])} seeds.",
    )


def consistency(runs: Experiments) -> StudyFigure:
    """Mean NIS and NEES by side, where they are expected."""
    table = pool([o.table for o in runs.drives[_SLOW]])
    table = table[table["tracker"].isin(PAPER_FILTERS)]
    table = table.assign(side=[SIDE_NAMES.get(side, side) for side in table["side"]])
    return StudyFigure(
        "consistency",
        "Mean NIS and NEES of the filters at 0.05 m/s",
        consistency_figure(table),
        "Above 2 a filter is overconfident: left about its fixes (grey: the 95 % band of all "
        "updates of all seeds), right about its position, where errors that all fixes share count.",
    )


def _drive(runs: Experiments) -> Drive:
    """The first seed's, with the paper's five filters."""
    drive = runs.drives[_SLOW][0].drive
    if drive is None:
        raise ValueError("expected the first seed to keep its drive, found none")
    return replace(drive, tracks=drive.tracks[drive.tracks["tracker"].isin(PAPER_FILTERS)])
