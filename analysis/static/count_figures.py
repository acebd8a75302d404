"""Figures of the study of the number of markers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from analysis.static.count_statistics import QUANTILES, CountResult
from analysis.study import StudyFigure
from analysis.style import FAINT, PALETTE, SEQUENTIAL, SHAPES, WIDE, new_figure
from pipeline.geometry import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# An ellipse of a two-dimensional Gaussian that holds 95 %: χ² with two degrees of freedom.
CHI2_95 = 5.991464547107979

# The second panel of the ellipses begins here, as in the paper.
ZOOM_FROM = 4

_BINS = 121
_LABELS = ("x (cm)", "y (cm)", "yaw (°)")


def violins(results: Sequence[CountResult], *, has_truth: bool) -> StudyFigure:
    """The distribution of the errors by number of markers; axes are clipped, the rest counted."""
    figure = new_figure((WIDE[0], 4.2))
    axes = figure.subplots(1, 3)
    outside = []
    for i, (axis, label) in enumerate(zip(axes, _LABELS, strict=True)):
        # Wide enough for two markers: one alone would flatten all the others.
        drawn = {r.markers: r.drawn[np.isfinite(r.drawn[:, i]), i] for r in results}
        scale = [v for n, v in drawn.items() if len(v) and (n >= 2 or len(drawn) == 1)]
        limit = max(1.3 * float(np.quantile(np.abs(scale[0]), 0.95)), 1e-6) if scale else 1.0
        for result in results:
            values = drawn[result.markers]
            _violin(axis, result.markers, values, limit)
            share = 100.0 * float((np.abs(values) > limit).mean()) if len(values) else 0.0
            if share >= 0.05:
                outside.append(f"{label.split(' ')[0]}, {result.markers}: {share:.1f} %")
        axis.axhline(0.0, color=FAINT, linewidth=0.8)
        axis.set(
            ylim=(-limit, limit),
            xlabel="number of markers",
            ylabel=f"{'error' if has_truth else 'deviation'} in {label}",
            xticks=[result.markers for result in results],
        )
        axis.grid(visible=False, axis="x")
    note = f" Beyond the axes: {'; '.join(outside)}." if outside else ""
    return StudyFigure(
        "count_violins",
        "Errors by number of markers",
        figure,
        "Thick line: middle half; thin line: 5 to 95 %; dot: median." + note,
    )


def _violin(axis: Axes, at: int, values: Array, limit: float) -> None:
    if not len(values):
        return
    edges = np.linspace(-limit, limit, _BINS + 1)
    density = np.histogram(values, edges)[0].astype(float)
    # Silverman's width from the middle half: outliers do not blur the rest.
    low, high = np.quantile(values, (0.25, 0.75))
    width = 0.9 * min(high - low, 1.349 * limit) / 1.349 * len(values) ** -0.2
    step = edges[1] - edges[0]
    reach = (np.arange(_BINS) - _BINS // 2) * step
    kernel = np.exp(-0.5 * (reach / max(width, 0.5 * step)) ** 2)
    density = np.convolve(density, kernel / kernel.sum(), mode="same")
    if density.max() > 0:
        half = 0.42 * density / density.max()
        middle = (edges[1:] + edges[:-1]) / 2.0
        shown = half > 0.002
        axis.fill_betweenx(
            middle, at - half, at + half, where=shown, color=PALETTE[5], alpha=0.6, linewidth=0
        )
    thin = np.quantile(values, (0.05, 0.95))
    axis.plot([at, at], thin, color="black", linewidth=1.0)
    axis.plot([at, at], [low, high], color="black", linewidth=3.5)
    axis.plot(at, np.median(values), "o", color="white", markeredgecolor="black", markersize=4.5)


def ellipses(results: Sequence[CountResult], *, has_truth: bool) -> StudyFigure:
    """Mean error and 95 % ellipse by number of markers: all, and from `ZOOM_FROM` on."""
    figure = new_figure((WIDE[0], 4.6))
    zoomed = [r for r in results if r.markers >= ZOOM_FROM]
    panels = figure.subplots(1, 2 if zoomed else 1, squeeze=False)[0]
    for axis, shown in zip(panels, (results, zoomed), strict=False):
        for result in shown:
            _ellipse(axis, result, results)
        axis.plot(0, 0, "+", color="black", markersize=12, label="truth" if has_truth else "origin")
        axis.set_aspect("equal", adjustable="datalim")
        what = "error" if has_truth else "deviation"
        axis.set(xlabel=f"{what} in x (cm)", ylabel=f"{what} in y (cm)")
        axis.set_title("all" if shown is results else f"{ZOOM_FROM} and more markers")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=8)
    return StudyFigure(
        "count_ellipses",
        "Mean error and 95 % ellipse by number of markers",
        figure,
        "Marks: mean errors; ellipses: those of Gaussians with the errors' covariance, holding "
        "95 %.",
    )


def _ellipse(axis: Axes, result: CountResult, results: Sequence[CountResult]) -> None:
    import matplotlib

    n = results.index(result)
    colour = matplotlib.colormaps[SEQUENTIAL](0.9 * n / max(1, len(results) - 1))
    axis.plot(
        *result.mean,
        SHAPES[n % len(SHAPES)],
        color=colour,
        markersize=6,
        linestyle="none",
        label=str(result.markers),
    )
    if np.isfinite(result.covariance).all():
        values, vectors = np.linalg.eigh(result.covariance)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        radii = np.sqrt(CHI2_95 * np.maximum(values, 0.0))
        axis.plot(*(result.mean[:, None] + vectors @ (radii[:, None] * circle)), color=colour)


def largest(results: Sequence[CountResult], *, has_truth: bool) -> StudyFigure:
    """The position error's maximum, quantiles and RMSE by number of markers."""
    figure = new_figure((WIDE[0] * 0.75, 4.2))
    axis = figure.subplots()
    markers = [r.markers for r in results]
    lines = [("max", "largest"), *((f"q{q}", f"{q} %") for q in reversed(QUANTILES))]
    if has_truth:
        lines.append(("rmse", "RMSE"))
    for n, (key, label) in enumerate(lines):
        values = [r.row[f"{key}_position_cm"] for r in results]
        axis.plot(markers, values, f"{SHAPES[n]}-", color=PALETTE[n], label=label)
    axis.set_yscale("log")
    axis.yaxis.set_major_formatter("{x:g}")
    what = "error" if has_truth else "distance from the pose of all markers"
    axis.set(xlabel="number of markers", ylabel=f"position {what} (cm)", xticks=markers)
    axis.legend()
    return StudyFigure(
        "count_largest",
        f"Largest position {what} and quantiles by number of markers",
        figure,
        "The knee is where the largest falls most.",
    )
