"""The jackknife over markers: how far a statistic of all subsets may be off.

A mean over all subsets of the markers is a U-statistic: leaving out one marker at a time, with all
subsets that it is in, gives its standard error (Arvesen, Ann. Math. Stat. 40:2076, 1969).
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from analysis.static.subsets import Layouts
from pipeline.geometry import Array

LEVEL = 0.95


def without_each(layouts: Layouts, per_subset: Array) -> Array:
    """(markers,) the sum of `per_subset` (M,) over those subsets that each marker is not in."""
    n_markers = len(layouts.ids)
    without = np.full(n_markers, per_subset.sum())
    for column in layouts.members.T:
        without -= np.bincount(column, per_subset, n_markers)
    return without


def half_width(left: Array) -> Array:
    """Of the 95 % interval of statistics (…) by their values (n, …) with one marker left out."""
    n = len(left)
    error = np.sqrt((n - 1) / n * ((left - left.mean(axis=0)) ** 2).sum(axis=0))
    return np.asarray(stats.t.ppf(0.5 + LEVEL / 2.0, n - 1) * error)
