"""Single markers and pairs."""

from __future__ import annotations

import numpy as np

from analysis.paper.configuration_one import (
    LARGE_M,
    Stand,
    horizontal_m,
    large_share,
    of_class,
    off_centre_m,
    rmse_m,
    separation_m,
    with_tags,
)
from analysis.paper.experiments import Experiments
from analysis.paper.pictures.seeds import paper_marks, strip
from analysis.paper.references import CLASSES, LARGE_SHARE, PLACEMENT_HIGH, PLACEMENT_LOW
from analysis.study import StudyFigure
from analysis.style import PALETTE, SHAPES, WIDE, new_figure, plain_log_scale
from pipeline.geometry import Array

_SINGLE = tuple(CLASSES)[1:]
_BINS = 8


def scatter(runs: Experiments) -> StudyFigure:
    """The errors of single markers in x and y, by class, at both heights."""
    figure = new_figure((WIDE[0], 4.6))
    panels = figure.subplots(1, 2)
    for axes, (name, stands, title, limit) in zip(
        panels,
        (
            ("configuration_1_low", runs.low, "1.334 m", 15.0),
            ("configuration_1_high", runs.high, "2.991 m", 100.0),
        ),
        strict=True,
    ):
        outside = 0
        for label, colour, shape in zip(_SINGLE, PALETTE, SHAPES, strict=False):
            errors = np.concatenate([of_class(runs.sites[name], s, label) for s in stands])
            xy = 100.0 * errors[:, :2]
            outside += int((np.abs(xy) > limit).any(axis=1).sum())
            axes.plot(*xy.T, shape, color=colour, markersize=3.5, alpha=0.6, label=label)
        axes.set(
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
        f"One mark for each marker of each of {len(runs.low)} seeds; the axes differ.",
    )


def rings(runs: Experiments) -> StudyFigure:
    """The share of large errors by ring, and by ring within a class."""
    site = runs.sites["configuration_1_high"]
    groups = [[with_tags(site, s, ring) for s in runs.high] for ring in _RINGS]
    groups += [[of_class(site, s, name) for s in runs.high] for name in _SINGLE]
    figure = new_figure((WIDE[0], 4.0))
    axes = figure.add_subplot()
    strip(axes, [*_RINGS, *_SINGLE], [[100.0 * large_share(e) for e in g] for g in groups])
    paper_marks(axes, [100.0 * LARGE_SHARE[ring] for ring in _RINGS] + [None] * len(_SINGLE))
    axes.axvline(len(_RINGS) - 0.5, color="#c0c0c0", linewidth=0.8)
    axes.set_ylabel(f"errors above {100 * LARGE_M:g} cm (%)")
    figure.legend(loc="outside lower center", ncols=2)
    return StudyFigure(
        "rings",
        "Large errors of single markers at 2.991 m, by ring",
        figure,
        "Left the rings as a whole, right within the classes of rotation.",
    )


_RINGS = ("inner", "outer")


def classes(runs: Experiments) -> StudyFigure:
    """The position RMSE by class at both heights."""
    figure = new_figure((WIDE[0], 4.0))
    panels = figure.subplots(1, 2)
    for axes, (name, stands, title, paper) in zip(
        panels,
        (
            ("configuration_1_low", runs.low, "1.334 m", PLACEMENT_LOW),
            ("configuration_1_high", runs.high, "2.991 m", PLACEMENT_HIGH),
        ),
        strict=True,
    ):
        site = runs.sites[name]
        labels = [label.replace(" ", "\n") for label in _SINGLE]
        strip(
            axes, labels, [[100.0 * rmse_m(of_class(site, s, n)) for s in stands] for n in _SINGLE]
        )
        paper_marks(
            axes, [float(np.hypot(paper[n].rmse_x_cm, paper[n].rmse_y_cm)) for n in _SINGLE]
        )
        axes.set(title=title, ylabel="position RMSE (cm)", yscale="log")
        plain_log_scale(axes.yaxis)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return StudyFigure(
        "classes", "Position RMSE of single markers, by class of rotation and ring", figure
    )


def pairs(runs: Experiments) -> StudyFigure:
    """The error of every pair against its separation and its distance from the centre."""
    site = runs.sites["configuration_1_high"]
    figure = new_figure((WIDE[0], 4.2))
    panels = figure.subplots(1, 2, sharey=True)
    error_cm = np.concatenate([_pair_errors_cm(s) for s in runs.high])
    for axes, (title, distance_m) in zip(
        panels,
        (
            ("separation of the two (m)", separation_m),
            ("mean distance from below the camera (m)", off_centre_m),
        ),
        strict=True,
    ):
        x = np.array([distance_m(site, p) for s in runs.high for p in s.pairs])
        axes.plot(x, error_cm, ".", color=PALETTE[0], markersize=2, alpha=0.15, rasterized=True)
        edges = np.linspace(x.min(), x.max(), _BINS + 1)
        bins = np.clip(np.digitize(x, edges) - 1, 0, _BINS - 1)
        filled = [i for i in range(_BINS) if (bins == i).any()]
        at = [float(x[bins == i].mean()) for i in filled]
        quartiles = np.array([np.quantile(error_cm[bins == i], (0.25, 0.5, 0.75)) for i in filled])
        axes.fill_between(at, quartiles[:, 0], quartiles[:, 2], color=PALETTE[1], alpha=0.25)
        axes.plot(at, quartiles[:, 1], "D-", color=PALETTE[1], label="median and quartiles")
        axes.set(xlabel=title, yscale="log")
    panels[0].set_ylabel("position error (cm)")
    plain_log_scale(panels[0].yaxis)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return StudyFigure(
        "pairs",
        "Two markers at 2.991 m: error against separation and distance from the centre",
        figure,
        f"One dot for each pair of each of {len(runs.high)} seeds.",
    )


def _pair_errors_cm(stand: Stand) -> Array:
    return 100.0 * horizontal_m(np.array(list(stand.pairs.values())))
