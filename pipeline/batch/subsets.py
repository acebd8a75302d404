"""Which subsets of an image's markers are solved: all of a size, or a random sample."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Index: TypeAlias = npt.NDArray[np.int64]

# Out of up to so many times as many numbers as are wanted, those drawn are marked in a table.
_DENSE = 16

# Subsets made from their ranks at a time.
_BLOCK = 65_536


def subsets(n: int, size: int) -> Index:
    """(M, size) every subset of `size` out of range(n), in lexicographic order."""
    if not 1 <= size <= n:
        raise ValueError(f"expected a size from 1 to {n}, found {size}")
    rows = np.arange(n, dtype=np.int64)[:, None]
    for _ in range(size - 1):
        counts = n - 1 - rows[:, -1]
        first = np.repeat(rows[:, -1] + 1 - (np.cumsum(counts) - counts), counts)
        added = first + np.arange(counts.sum())
        rows = np.column_stack([np.repeat(rows, counts, axis=0), added])
    return rows


def sample_subsets(n: int, size: int, count: int, seed: int) -> Index:
    """(M, size) `count` different random subsets in lexicographic order; all where that is fewer.

    Raises:
        ValueError: the size is not from 1 to n, or there are more subsets than an int64 counts.
    """
    if not 1 <= size <= n:
        raise ValueError(f"expected a size from 1 to {n}, found {size}")
    total = math.comb(n, size)
    if total <= count:
        return subsets(n, size)
    if total > np.iinfo(np.int64).max:
        raise ValueError(f"expected fewer than 2**63 subsets, found {size} of {n}")
    ranks = _distinct(total, count, np.random.default_rng(seed))
    rows = np.zeros((count, size), dtype=np.int64)
    for first in range(0, count, _BLOCK):
        _unrank(n, ranks[first : first + _BLOCK], rows[first : first + _BLOCK])
    return rows


def _unrank(n: int, ranks: Index, rows: Index) -> None:
    """Writes to `rows` (M, size) the subsets of range(n) with `ranks` (M,), which are spoilt."""
    count, size = rows.shape
    missing = np.full(count, size)
    for marker in range(n):
        # How many of the subsets left begin with this marker.
        begin = np.array([math.comb(n - 1 - marker, m - 1) if m else 0 for m in range(size + 1)])
        beginning = begin[missing]
        taken = (ranks < beginning) & (missing > 0)
        rows[taken, size - missing[taken]] = marker
        ranks -= np.where(taken, 0, beginning)
        missing -= taken


def _distinct(total: int, count: int, rng: np.random.Generator) -> Index:
    """(count,) different numbers below `total`, ascending, every set of them as likely.

    What is missing is drawn again and again; memory is of the order of `count`, not of `total`.
    """
    if total > _DENSE * count:
        ranks = np.empty(0, dtype=np.int64)
        while missing := count - len(ranks):
            ranks = np.sort(np.concatenate([ranks, rng.integers(0, total, missing)]))
            ranks = ranks[np.diff(ranks, prepend=-1) > 0]
        return ranks
    drawn = np.zeros(total, dtype=bool)
    # Of nearly all numbers it is quicker to draw those that are left out.
    wanted = min(count, total - count)
    while missing := wanted - int(np.count_nonzero(drawn)):
        drawn[rng.integers(0, total, missing)] = True
    return np.flatnonzero(drawn if wanted == count else ~drawn)
