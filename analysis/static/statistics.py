"""Statistics of errors, and how far each may be off: a bootstrap over frames and markers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import stats

from pipeline.geometry import Array

# Of the errors: root mean square, mean, standard deviation about the mean, largest magnitude and
# 95 % quantile of the magnitude. rmse² = bias² + std².
STATISTICS = ("rmse", "bias", "std", "max", "q95")

# A percentile interval over fewer units says nothing.
MIN_MARKERS = 3

# Cells times resamples held at once.
_CHUNK = 4_000_000


def statistics(errors: Array) -> dict[str, float]:
    """Each of `STATISTICS` over the finite errors; NaN where there are too few.

    The standard deviation divides by n, so that rmse² = bias² + std²; it needs two values, the
    quantile (linear between order statistics) and the others one.
    """
    finite = errors[np.isfinite(errors)]
    if not finite.size:
        return dict.fromkeys(STATISTICS, np.nan)
    magnitude = np.abs(finite)
    return {
        "rmse": float(np.sqrt(np.mean(finite**2))),
        "bias": float(np.mean(finite)),
        "std": float(np.std(finite)) if finite.size > 1 else np.nan,
        "max": float(magnitude.max()),
        "q95": float(np.quantile(magnitude, 0.95)),
    }


@dataclass(frozen=True)
class Bootstrap:
    """A two-way (pigeonhole) bootstrap: frames and markers are both drawn with replacement.

    The percentiles are moved outwards so that the interval of a mean is as wide as Student's t
    with the number of markers would make it (Hesterberg, Am. Stat. 69:371, 2015): plain
    percentiles of few markers are too narrow.
    """

    resamples: int = 2000
    seed: int = 0
    level: float = 0.95

    def intervals(self, errors: Array) -> dict[str, tuple[float, float]]:
        """The interval of each of `STATISTICS`.

        Args:
            errors: (frames, markers), NaN where a frame has no fix of a marker.

        Returns:
            (low, high); NaN with fewer than `MIN_MARKERS` markers that have a fix. An interval
            of the maximum cannot reach above the largest error seen.
        """
        errors = errors[:, np.isfinite(errors).any(axis=0)]
        if errors.shape[1] < MIN_MARKERS:
            return dict.fromkeys(STATISTICS, (np.nan, np.nan))
        drawn = [self._statistics(errors, *weights) for weights in self._weights(errors.shape)]
        tail = self.tail(errors.shape[1])
        found = {}
        for i, name in enumerate(STATISTICS):
            values = np.concatenate([chunk[i] for chunk in drawn])
            low, high = np.nanquantile(values, (tail, 1.0 - tail))
            found[name] = (float(low), float(high))
        return found

    def tail(self, n_markers: int) -> float:
        """The share that the interval leaves out on each side of the resamples."""
        t = stats.t.ppf(0.5 + self.level / 2.0, n_markers - 1)
        return float(stats.norm.sf(np.sqrt(n_markers / (n_markers - 1)) * t))

    def mean_interval(self, values: Array) -> tuple[float, float]:
        """The interval of the mean alone: for shares, with `values` of 0 and 1."""
        return self.intervals(values)["bias"]

    def _weights(self, shape: tuple[int, ...]) -> Iterator[tuple[Array, Array]]:
        """How often each resample draws each frame and marker, some resamples at a time."""
        frames, markers = shape
        rng = np.random.default_rng(self.seed)
        step = max(1, _CHUNK // (frames * markers))
        for start in range(0, self.resamples, step):
            size = min(step, self.resamples - start)
            yield (
                rng.multinomial(frames, np.full(frames, 1 / frames), size).astype(np.float64),
                rng.multinomial(markers, np.full(markers, 1 / markers), size).astype(np.float64),
            )

    @staticmethod
    def _statistics(errors: Array, frame_weights: Array, marker_weights: Array) -> list[Array]:
        """`STATISTICS` of each resample (B,), as if its cells were repeated as often as drawn."""
        known = np.isfinite(errors)
        rows, columns = np.nonzero(known)
        values = errors[rows, columns]
        order = np.argsort(np.abs(values), kind="stable")
        values, rows, columns = values[order], rows[order], columns[order]
        magnitude = np.abs(values)
        weights = frame_weights[:, rows] * marker_weights[:, columns]
        cumulative = np.cumsum(weights, axis=1)
        total = cumulative[:, -1]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = weights @ values / total
            square = weights @ values**2 / total
        spread = np.sqrt(np.maximum(square - mean**2, 0.0))

        def ranked(rank: Array) -> Array:
            """The magnitude at a rank (from 0) of each resample's repeated values."""
            at = (cumulative <= rank[:, None]).sum(axis=1)
            return np.asarray(magnitude[np.minimum(at, len(magnitude) - 1)])

        position = 0.95 * (total - 1.0)
        below, above = ranked(np.floor(position)), ranked(np.ceil(position))
        q95 = below + (position - np.floor(position)) * (above - below)
        results = [np.sqrt(square), mean, spread, ranked(total - 1.0), q95]
        return [np.where(total > 0, result, np.nan) for result in results]


def wilson(successes: int, n: int, level: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a share of independent yes-or-no units; NaN without any."""
    if not n:
        return np.nan, np.nan
    z = float(stats.norm.ppf(0.5 + level / 2.0))
    share = successes / n
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))
