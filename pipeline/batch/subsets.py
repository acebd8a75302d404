"""Which subsets of an image's markers are solved: all of a size, or a random sample."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Index: TypeAlias = npt.NDArray[np.int64]


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
    ranks = np.sort(np.random.default_rng(seed).choice(total, count, replace=False))
    rows = np.zeros((count, size), dtype=np.int64)
    missing = np.full(count, size)
    for marker in range(n):
        # How many of the subsets left begin with this marker.
        begin = np.array([math.comb(n - 1 - marker, m - 1) if m else 0 for m in range(size + 1)])
        taken = (ranks < begin[missing]) & (missing > 0)
        rows[taken, size - missing[taken]] = marker
        ranks -= np.where(taken, 0, begin[missing])
        missing -= taken
    return rows
