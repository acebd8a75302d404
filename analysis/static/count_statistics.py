"""What is kept of all the fixes with one number of markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from analysis.static.alone import AXES
from analysis.static.jackknife import half_width, without_each
from analysis.static.statistics import MIN_MARKERS
from analysis.static.subsets import IntArray, Layouts, SubsetFixes, differences
from analysis.static.view import StillView
from pipeline.geometry import Array

if TYPE_CHECKING:
    import pandas as pd

QUANTILES = (50, 95, 99)

# Subsets named at each end.
EXTREMES = 10

# A fall of the largest error by less than this factor is no knee.
CLEAR_KNEE = 2.0

# Fixes kept of each size for the figures.
_DRAWN = 20_000

SCALE = np.array([scale for *_, scale in AXES])


@dataclass(frozen=True, eq=False)
class CountResult:
    """What is left of one size's fixes.

    Attributes:
        row: the statistics, by column name.
        mean, covariance: (2,), (2, 2) of the x and y errors in cm, cm².
        drawn: (≤ 20 000, 3) evenly spaced of the errors in cm, cm, degrees.
        extremes: the worst and the best subsets.
    """

    markers: int
    row: dict[str, Any]
    mean: Array
    covariance: Array
    drawn: Array
    extremes: pd.DataFrame
    extents: dict[str, float]


def summarize(
    view: StillView, fixes: SubsetFixes, reference: Array, *, has_truth: bool
) -> CountResult:
    """The statistics of one size; `reference` (frames, 3) is the truth or what stands for it."""
    layouts = fixes.layouts
    errors = differences(fixes.values, reference[:, None, :])
    errors *= SCALE
    position = np.hypot(errors[..., 0], errors[..., 1])
    known = np.isfinite(position)
    # A view where it can be one: these are the largest arrays of a study.
    flat = errors.reshape(-1, 3) if known.all() else errors[known]
    row: dict[str, Any] = {
        "markers": layouts.size,
        "subsets": len(layouts.members),
        "of": layouts.of,
        "fixes": int(known.sum()),
        "failed": int((~known).sum()),
        "unsettled": int((known & ~fixes.converged).sum()),
    }
    columns = {(axis, unit): flat[:, i] for axis, i, unit, _ in AXES}
    row |= _intervals(layouts, errors, known, has_truth=has_truth)
    columns["position", "cm"] = position[known]
    for (axis, unit), values in columns.items():
        row |= _statistics(axis, unit, values, has_truth=has_truth)
    enough = len(flat) > 1
    return CountResult(
        layouts.size,
        row,
        flat[:, :2].mean(axis=0) if len(flat) else np.full(2, np.nan),
        np.cov(flat[:, :2].T, bias=True) if enough else np.full((2, 2), np.nan),
        # A copy: a view would keep all of them.
        flat[:: max(1, -(-len(flat) // _DRAWN))].copy(),
        *_extremes(view, fixes, position),
    )


def _statistics(axis: str, unit: str, values: Array, *, has_truth: bool) -> dict[str, float]:
    values = values[np.isfinite(values)]
    row = dict.fromkeys((f"rmse_{axis}_{unit}", f"bias_{axis}_{unit}"), np.nan)
    row |= {f"{name}_{axis}_{unit}": np.nan for name in ("max", *(f"q{q}" for q in QUANTILES))}
    row[f"var_{axis}_{unit}2"] = float(np.var(values)) if len(values) > 1 else np.nan
    if len(values):
        magnitude = np.abs(values)
        if has_truth:
            row[f"rmse_{axis}_{unit}"] = float(np.sqrt(np.mean(values**2)))
            row[f"bias_{axis}_{unit}"] = float(values.mean())
        row[f"max_{axis}_{unit}"] = float(magnitude.max())
        quantiles = np.quantile(magnitude, np.array(QUANTILES) / 100.0)
        row |= {f"q{q}_{axis}_{unit}": float(v) for q, v in zip(QUANTILES, quantiles, strict=True)}
    return row


def _intervals(
    layouts: Layouts, errors: Array, known: npt.NDArray[np.bool_], *, has_truth: bool
) -> dict[str, float]:
    """Of RMSE and mean error, by the jackknife over markers; NaN with too few of them.

    Args:
        errors: (frames, M, 3), `known` (frames, M) where they are finite.
    """
    row = {}
    count = without_each(layouts, known.sum(axis=0).astype(np.float64))
    left_out = count > 0.5
    enough = has_truth and left_out.sum() >= MIN_MARKERS and 2 * layouts.size <= len(layouts.ids)
    for axis, i, unit, _ in AXES:
        low = high = mean = half = np.nan
        finite = np.where(known, errors[..., i], 0.0)
        if enough and np.isfinite(finite).all():
            n = known.sum()
            mean, square = finite.sum() / n, (finite**2).sum() / n
            means = without_each(layouts, finite.sum(axis=0))[left_out] / count[left_out]
            half = float(half_width(means)) or np.nan
            squares = without_each(layouts, (finite**2).sum(axis=0))[left_out] / count[left_out]
            if (squares > 0).all() and np.ptp(squares) > 0:
                error = 0.5 * float(half_width(np.log(squares)))
                low, high = np.sqrt(square) * np.exp([-error, error])
        row[f"rmse_{axis}_low_{unit}"], row[f"rmse_{axis}_high_{unit}"] = float(low), float(high)
        row[f"bias_{axis}_low_{unit}"] = float(mean - half)
        row[f"bias_{axis}_high_{unit}"] = float(mean + half)
    return row


def _extremes(
    view: StillView, fixes: SubsetFixes, position_cm: Array
) -> tuple[pd.DataFrame, dict[str, float]]:
    """The worst and the best subsets by name, and how far the markers of such reach."""
    import pandas as pd

    layouts = fixes.layouts
    known = np.isfinite(position_cm)
    solved = np.flatnonzero(known.any(axis=0))
    cm = np.sqrt(np.nansum(position_cm[:, solved] ** 2, axis=0) / known[:, solved].sum(axis=0))
    order = np.argsort(cm, kind="stable")
    extent = _extents_m(view, layouts.ids, layouts.members)
    best, worst = solved[order[:EXTREMES]], solved[order[::-1][:EXTREMES]]
    frame = pd.DataFrame(
        [
            {
                "markers": layouts.size,
                "rank": rank + 1,
                "worst": layouts.named(w),
                "worst_cm": cm[order[-1 - rank]],
                "worst_extent_m": extent[w],
                "best": layouts.named(b),
                "best_cm": cm[order[rank]],
                "best_extent_m": extent[b],
            }
            for rank, (w, b) in enumerate(zip(worst, best, strict=True))
        ]
    )
    extents = {
        "all": float(np.median(extent)),
        "worst": float(np.median(extent[worst])) if len(worst) else np.nan,
        "best": float(np.median(extent[best])) if len(best) else np.nan,
    }
    return frame, extents


def _extents_m(view: StillView, ids: Sequence[int], members: IntArray) -> Array:
    """(M,) largest distance between two markers of each subset."""
    centres = np.array([view.marker_map.by_id[i].centre_m for i in ids])
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    extent = np.zeros(len(members))
    for i in range(members.shape[1]):
        for j in range(i):
            np.maximum(extent, distance[members[:, i], members[:, j]], out=extent)
    return extent


@dataclass(frozen=True)
class Knee:
    """From `markers` on the largest error is smaller: it falls there from `before` to `after`."""

    markers: int
    before: float
    after: float

    @property
    def factor(self) -> float:
        return self.before / self.after


def knee(markers: Sequence[int], largest: Sequence[float]) -> Knee | None:
    """The largest relative drop of the maximum between successive counts; None without any."""
    drops = [
        Knee(n, before, after)
        for n, before, after in zip(markers[1:], largest[:-1], largest[1:], strict=True)
        if 0 < after < before
    ]
    return max(drops, key=lambda drop: drop.factor, default=None)
