"""Numbers of markers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.paper.configuration_one import CountErrors, size, solved_whole
from analysis.paper.experiments import Experiments
from analysis.paper.pictures.seeds import curves
from analysis.paper.references import COUNT
from analysis.study import StudyFigure
from analysis.style import PALETTE, SHAPES, TRUTH_COLOUR, WIDE, new_figure, plain_log_scale


def errors(runs: Experiments) -> StudyFigure:
    """RMSE, largest error and mean error by number of markers, over the seeds."""
    figure = new_figure((WIDE[0], 4.2))
    panels = figure.subplots(1, 3)
    numbers = sorted(runs.high[0].counts)
    kinds: dict[str, Callable[[CountErrors], float]] = {
        "RMSE": lambda c: size(c.rmse),
        "largest error": lambda c: c.max_m,
        "size of the mean error": lambda c: size(c.mean),
    }
    paper = {
        "RMSE": [float(np.hypot(COUNT[n].rmse_x_cm, COUNT[n].rmse_y_cm)) for n in numbers],
        "size of the mean error": [
            float(np.hypot(COUNT[n].mean_x_cm, COUNT[n].mean_y_cm)) for n in numbers
        ],
    }
    solvers = {"the paper's solver": "counts", "batch": "batch"}
    for axes, (title, value) in zip(panels, kinds.items(), strict=True):
        for (label, key), colour, mark in zip(solvers.items(), PALETTE, SHAPES, strict=False):
            stands = [getattr(s, key) for s in runs.high]
            last = solved_whole(stands[0]) if title == "largest error" else numbers[-1]
            cm = 100.0 * np.array([[value(s[n]) for n in numbers[:last]] for s in stands])
            curves(axes, numbers[:last], cm, mark, colour, label)
        if title in paper:
            axes.plot(numbers, paper[title], "D:", color=TRUTH_COLOUR, label="paper")
        axes.set(title=title, xlabel="markers", ylabel="cm", yscale="log", xticks=numbers)
        plain_log_scale(axes.yaxis)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return StudyFigure(
        "count",
        "By number of markers at 2.991 m",
        figure,
        "Subsets of one to seven of the 24 markers (the paper's solver: a random sample of those "
        "of six and seven, whose largest error is left out); a thin line for each seed, the "
        "median thick.",
    )


def axes(runs: Experiments) -> StudyFigure:
    """RMSE in x, y and heading by number of markers beside the paper's."""
    numbers = sorted(runs.high[0].counts)
    rmse = np.array([[s.counts[n].rmse for n in numbers] for s in runs.high])
    figure = new_figure((WIDE[0], 4.2))
    position, heading = figure.subplots(1, 2)
    for i, (axis, field) in enumerate((("x", "rmse_x_cm"), ("y", "rmse_y_cm"))):
        curves(position, numbers, 100.0 * rmse[..., i], SHAPES[i], PALETTE[i], f"{axis}, here")
        values = [getattr(COUNT[n], field) for n in numbers]
        style = ":" if axis == "x" else "--"
        position.plot(
            numbers, values, f"{SHAPES[i]}{style}", color=TRUTH_COLOUR, label=f"{axis}, paper"
        )
    curves(heading, numbers, np.degrees(rmse[..., 2]), SHAPES[2], PALETTE[2], "heading, here")
    values = [COUNT[n].rmse_yaw_deg for n in numbers]
    heading.plot(numbers, values, f"{SHAPES[2]}:", color=TRUTH_COLOUR, label="heading, paper")
    position.set(title="position", ylabel="RMSE (cm)")
    heading.set(title="heading", ylabel="RMSE (°)")
    for panel in (position, heading):
        panel.set(xlabel="markers", yscale="log", xticks=numbers)
        plain_log_scale(panel.yaxis)
    figure.legend(loc="outside lower center", ncols=3)
    return StudyFigure(
        "axes",
        "RMSE in x, y and heading at 2.991 m, by number of markers",
        figure,
        "The paper's solver; a thin line for each seed, the median thick.",
    )
