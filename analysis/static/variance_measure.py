"""How much the fixes of one number of markers scatter, and how well that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.static.jackknife import half_width, without_each
from analysis.static.subsets import SubsetFixes
from pipeline.geometry import Array

# Fewer fixes than this measure no variance.
MIN_FIXES = 10

# Fewer different layouts than this say nothing of how layouts differ.
MIN_SUBSETS = 5

# Sample sizes whose effect is tried, each with so many draws.
TRIED = (100, 1000, 10_000)
DRAWS = 200

# From a Gaussian's median absolute deviation to its standard deviation.
MAD_TO_STD = 1.482602218505602


@dataclass(frozen=True, eq=False)
class MeasuredVariance:
    """The variance of one number of markers, x and y, about the mean over all fixes.

    Attributes:
        cm2, robust_cm2: (2,); the robust one is (1.4826 MAD)². NaN with too few fixes.
        low_cm2, high_cm2: (2,) 95 % interval: what other markers would have given.
        spread: by sample size, (2, 2) the 2.5 and 97.5 % of what samples of that size give,
            relative to all, for x and y; sizes that are no sample are absent.
    """

    markers: int
    subsets: int
    of: int
    fixes: int
    cm2: Array
    robust_cm2: Array
    low_cm2: Array
    high_cm2: Array
    spread: dict[int, Array]


def measure(fixes: SubsetFixes, seed: int = 0) -> MeasuredVariance:
    """The variance of one size's fixes; needs no truth."""
    layouts = fixes.layouts
    known = np.asarray(np.isfinite(fixes.values).all(axis=2))
    xy = 100.0 * fixes.values[..., :2]
    n = int(known.sum())
    nothing = np.full(2, np.nan)
    if n < MIN_FIXES:
        few = (nothing,) * 4
        return MeasuredVariance(layouts.size, len(layouts.members), layouts.of, n, *few, {})
    flat = xy[known]
    cm2 = flat.var(axis=0)
    deviation = np.abs(flat - np.median(flat, axis=0))
    robust_cm2 = (MAD_TO_STD * np.median(deviation, axis=0)) ** 2
    low, high = _interval(fixes, xy, known, cm2)
    return MeasuredVariance(
        layouts.size,
        len(layouts.members),
        layouts.of,
        n,
        cm2,
        robust_cm2,
        low,
        high,
        _spread(flat, cm2, np.random.default_rng([seed, layouts.size])),
    )


def _interval(
    fixes: SubsetFixes, xy: Array, known: npt.NDArray[np.bool_], cm2: Array
) -> tuple[Array, Array]:
    """95 % by the jackknife over markers, on the logarithm."""
    centred = np.where(known[..., None], xy - xy[known].mean(axis=0), 0.0)
    per_subset = np.concatenate(
        [known.sum(axis=0)[:, None], centred.sum(axis=0), (centred**2).sum(axis=0)], axis=1
    )
    without = np.stack([without_each(fixes.layouts, sums) for sums in per_subset.T], axis=1)
    enough = without[:, 0] > 1.5
    if enough.sum() < 3 or not (cm2 > 0).all():
        return np.full(2, np.nan), np.full(2, np.nan)
    count = without[enough, :1]
    left = without[enough, 3:] / count - (without[enough, 1:3] / count) ** 2
    if not (left > 0).all():
        return np.full(2, np.nan), np.full(2, np.nan)
    half = half_width(np.log(left))
    return cm2 * np.exp(-half), cm2 * np.exp(half)


def _spread(flat: Array, cm2: Array, rng: np.random.Generator) -> dict[int, Array]:
    found = {}
    for size in TRIED:
        if size >= len(flat) or not (cm2 > 0).all():
            continue
        drawn = [flat[rng.integers(0, len(flat), size)].var(axis=0) for _ in range(DRAWS)]
        found[size] = np.quantile(drawn, (0.025, 0.975), axis=0).T / cm2[:, None]
    return found


def usable_rows(measured: Sequence[MeasuredVariance]) -> list[MeasuredVariance]:
    """The rows from one marker on, up to the first that measures nothing but its frames' noise.

    All markers together are one layout: what it scatters by from frame to frame says nothing of
    how layouts differ, and a filter would trust it a hundredfold.
    """
    rows = []
    for row in measured:
        if row.subsets < MIN_SUBSETS or not np.isfinite(row.high_cm2).all():
            break
        if not ((row.cm2 > 0).all() and (row.robust_cm2 > 0).all()):
            break
        rows.append(row)
    return rows
