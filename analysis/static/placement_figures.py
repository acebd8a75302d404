"""Figures of the placement study."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.static.alone import Alone
from analysis.static.pairs import Pairs, thirds
from analysis.study import StudyFigure, StudyTable
from analysis.style import FAINT, PALETTE, SEQUENTIAL, SHAPES, SINGLE, WIDE, new_figure
from pipeline.geometry import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Axes reach a little beyond most errors; what lies outside is counted instead of drawn.
_SHOWN_QUANTILE = 0.9
_MARGIN = 1.5


def distribution(views: Sequence[Alone]) -> StudyFigure:
    """x against y error of every fix, by class, one panel for each height."""
    columns = min(2, len(views))
    rows = -(-len(views) // columns)
    size = WIDE if columns == 2 else SINGLE
    figure = new_figure((size[0], size[1] * rows))
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    outside = [_distribution(axis, view) for axis, view in zip(axes, views, strict=False)]
    for axis in axes[len(views) :]:
        axis.set_axis_off()
    handles: dict[str, Any] = {}
    for axis in axes[: len(views)]:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3 * columns)
    counts = "; ".join(
        f"{view.label}: {n} of {total}" for view, (n, total) in zip(views, outside, strict=True)
    )
    return StudyFigure(
        "placement_xy",
        "Error of one marker alone, by class",
        figure,
        "Large marks: each marker's mean over the frames; small ones: single fixes. Filled: outer "
        f"ring. Fixes outside the frame are not drawn ({counts}).",
    )


def _distribution(axis: Axes, view: Alone) -> tuple[int, int]:
    """Draws one panel; how many fixes are outside, and of how many."""
    xy = view.errors[..., :2]
    known = np.isfinite(xy).all(axis=2)
    limit = _MARGIN * max(float(np.quantile(np.abs(xy[known]), _SHOWN_QUANTILE)), 1e-3)
    classes = sorted(
        set(view.grouping.class_of.values()), key=lambda c: -float(c.removesuffix("°"))
    )
    names = classes or [ring.name for ring in view.grouping.rings]
    of = view.grouping.class_of if classes else view.grouping.ring_of
    for n, (name, colour) in enumerate(zip(names, PALETTE, strict=False)):
        for ring in view.grouping.rings if classes else (None,):
            ids = [
                i
                for i in view.view.ids
                if of.get(i) == name and (ring is None or view.grouping.ring_of.get(i) == ring.name)
            ]
            if not ids:
                continue
            errors = view.of(ids)[..., :2]
            flat = errors.reshape(-1, 2)
            hollow = ring is not None and ring.name == view.grouping.rings[0].name
            axis.plot(*flat.T, ".", color=colour, alpha=0.25, markersize=3)
            solved = np.isfinite(errors).all(axis=2).any(axis=0)
            means = np.nanmean(errors[:, solved], axis=0)
            axis.plot(
                *means.T,
                SHAPES[n],
                linestyle="none",
                color=colour,
                markerfacecolor="white" if hollow else colour,
                markersize=7,
                label=name if ring is None else f"{name} {ring.name}",
            )
    axis.axhline(0.0, color=FAINT, linewidth=0.8)
    axis.axvline(0.0, color=FAINT, linewidth=0.8)
    axis.set(
        xlim=(-limit, limit),
        ylim=(-limit, limit),
        xlabel="error in x (cm)",
        ylabel="error in y (cm)",
        title=f"camera height {view.label}",
    )
    axis.set_aspect("equal")
    outside = int((np.abs(xy[known]) > limit).any(axis=1).sum())
    axis.text(
        0.02,
        0.98,
        f"{outside} of {int(known.sum())} outside",
        transform=axis.transAxes,
        va="top",
        fontsize=9,
    )
    return outside, int(known.sum())


def shares(table: StudyTable, views: Sequence[Alone], large_cm: float) -> StudyFigure:
    """The share of large errors by ring, bars with intervals, one group for each height."""
    figure = new_figure()
    panels = figure.subplots(1, 2, sharey=True)
    heights = [view.height for view in views]
    rings = list(dict.fromkeys(table.frame["ring"]))
    width = 0.8 / len(rings)
    for axis, what in zip(panels, ("markers", "fixes"), strict=True):
        for n, (ring, colour) in enumerate(zip(rings, PALETTE, strict=False)):
            rows = table.frame[table.frame["ring"] == ring]
            at = np.array([heights.index(h) for h in rows["height_m"]]) - 0.4 + (n + 0.5) * width
            share = rows[f"{what}_above_pct"].to_numpy(dtype=float)
            ends = rows[[f"{what}_low_pct", f"{what}_high_pct"]].to_numpy(dtype=float).T
            axis.bar(
                at,
                share,
                0.9 * width,
                color=colour,
                alpha=0.85,
                label=ring,
                hatch="//" if n else "",
            )
            known = np.isfinite(ends).all(axis=0)
            bars = np.abs(ends - share)[:, known]
            axis.errorbar(at[known], share[known], bars, fmt="none", ecolor="black", capsize=4)
        axis.set_xticks(range(len(views)), [v.label.replace(" (", "\n(") for v in views])
        axis.set(xlabel="camera height", ylim=(0, 100), title=f"of the {what}")
        axis.grid(visible=False, axis="x")
    panels[0].set_ylabel(f"error above {large_cm:g} cm (%)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return StudyFigure(
        "placement_share",
        f"Share of errors above {large_cm:g} cm by ring",
        figure,
        "Left: markers whose root mean square error is above; right: single fixes. Thin bars: 95 % "
        "intervals; none where too few markers give none.",
    )


def pairs(view: Alone, found: Pairs) -> StudyFigure:
    """A pair's error against its separation, its distance from the centre, and both."""
    figure = new_figure((WIDE[0], 3.6))
    separation, centre, both = figure.subplots(1, 3)
    _scatter(separation, found.separation_m, found.rms_cm, "separation (m)")
    _scatter(centre, found.centre_px, found.rms_cm, "from the image centre (px)")
    separation.set_ylabel("horizontal error (cm)")
    near, far = thirds(found.separation_m), thirds(found.centre_px)
    median = np.full((3, 3), np.nan)
    for s in range(3):
        for c in range(3):
            cell = found.rms_cm[(near.part == s) & (far.part == c)]
            if len(cell):
                median[c, s] = np.median(cell)
    shown = both.imshow(np.log10(median), origin="lower", cmap=SEQUENTIAL, aspect="auto")
    middle = np.nanmean(np.log10(median))
    for (c, s), value in np.ndenumerate(median):
        if np.isfinite(value):
            colour = "white" if np.log10(value) < middle else "black"
            both.text(s, c, f"{value:.2g}", ha="center", va="center", color=colour)
    shown.set_clim(np.nanmin(np.log10(median)), np.nanmax(np.log10(median)))
    both.set_xticks(range(3), [name.replace(" to ", "–") for name in near.names(2)])
    both.set_yticks(range(3), [name.replace(" to ", "–\n") for name in far.names(0)])
    both.set(xlabel="separation (m)", ylabel="from the centre (px)", title="median error (cm)")
    both.grid(visible=False)
    return StudyFigure(
        "placement_pairs_" + re.sub(r"\W+", "_", view.height).strip("_"),
        f"Two markers at {view.label}: error by separation and distance from the image centre",
        figure,
        f"Each dot is one of {len(found.ids)} pairs; the line joins medians of eighths; cells "
        "are thirds of the pairs.",
    )


def _scatter(axis: Axes, at: Array, cm: Array, xlabel: str) -> None:
    axis.plot(at, cm, ".", color=PALETTE[5], alpha=0.5, markersize=4)
    parts = [p for p in np.array_split(np.argsort(at, kind="stable"), 8) if len(p)]
    axis.plot(
        [np.median(at[p]) for p in parts],
        [np.median(cm[p]) for p in parts],
        "o-",
        color=PALETTE[1],
        markersize=5,
    )
    axis.set_yscale("log")
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_xlabel(xlabel)
