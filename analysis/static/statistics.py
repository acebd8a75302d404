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

# Of fewer markers no interval holds the truth as often as it says.
MIN_MARKERS = 4

# Resamples below this share of the estimate count as that share: among few markers some resamples
# draw a single one, whose spread of next to nothing has no useful logarithm.
_FLOOR = 0.5

# How far the upper end of an interval on the logarithm reaches further, in squared standard errors:
# a root of few squares is rather too small than too large. By measured coverage.
_SKEW = 3.0

# Below this share of the RMSE a scatter is rounding.
_ROUNDING = 1e-6

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

    Percentiles of few markers cannot reach beyond what these markers did, so the resamples give
    the standard error, widened by sqrt(n / (n - 1)), and Student's t with the number n of markers
    the width: about the mean as it is, about the others on the logarithm, its upper end further
    out. The standard deviation is centred on its unbiased estimate; to the quantile's error is
    added the RMSE's, for its resamples do not reach above the largest error seen. Of the maximum
    the middle 95 % of the resamples are given: no population has a largest error to be covered.

    Coverage of the 95 % intervals, measured with 4 to 16 markers whose own errors dominate, in one
    to ten frames: normal errors 93 to 100 %, heavy-tailed ones (Laplace; Student's t with four
    degrees of freedom) 87 to 99 %. Strongly skewed ones (lognormal) fall short: mean 87 to 95 %,
    RMSE, standard deviation and quantile 76 to 95 %; so do a few frames whose markers err together
    by twice as much as they differ (86 to 95 % in four frames, 93 to 99 % in ten).
    """

    resamples: int = 2000
    seed: int = 0
    level: float = 0.95

    def intervals(self, errors: Array) -> dict[str, tuple[float, float]]:
        """The interval of each of `STATISTICS`.

        Args:
            errors: (frames, markers), NaN where a frame has no fix of a marker.

        Returns:
            (low, high); NaN with fewer than `MIN_MARKERS` markers that have a fix, and where all
            resamples are the same.
        """
        found = dict.fromkeys(STATISTICS, (np.nan, np.nan))
        errors = errors[:, np.isfinite(errors).any(axis=0)]
        if errors.shape[1] < MIN_MARKERS:
            return found
        n_markers = errors.shape[1]
        t = float(stats.t.ppf(0.5 + self.level / 2.0, n_markers - 1))
        estimate, drawn = statistics(errors), self._draw(errors)
        least = _ROUNDING * estimate["rmse"]
        scattered = {name for name in STATISTICS if np.nanstd(drawn[name]) > least}
        mean_error = _standard_error(drawn["bias"], n_markers)
        if "bias" in scattered:
            mean = estimate["bias"]
            found["bias"] = mean - t * mean_error, mean + t * mean_error
        if "max" in scattered:
            tail = (1.0 - self.level) / 2.0
            low, high = np.nanquantile(drawn["max"], (tail, 1.0 - tail))
            found["max"] = float(low), float(high)
        rmse_error = 0.0
        for name in (name for name in ("rmse", "std", "q95") if name in scattered):
            floored = np.maximum(drawn[name], _FLOOR * estimate[name])
            error = _standard_error(np.log(floored), n_markers)
            centre = estimate[name]
            if name == "rmse":
                rmse_error = error
            elif name == "std":
                # E[var] = σ² - Var[mean]
                centre = float(np.hypot(centre, mean_error))
            else:
                error = float(np.hypot(error, rmse_error))
            upper = t * error + _SKEW * error**2
            found[name] = float(centre * np.exp(-t * error)), float(centre * np.exp(upper))
        return found

    def share_interval(self, flags: Array) -> tuple[float, float]:
        """The interval of the share of ones among `flags` (frames, markers) of 0, 1 and NaN.

        Wilson's, of as many independent fixes as would scatter like the resamples; of as many as
        there are markers where all fixes are the same. NaN with fewer than `MIN_MARKERS`.
        """
        flags = flags[:, np.isfinite(flags).any(axis=0)]
        n_markers = flags.shape[1]
        if n_markers < MIN_MARKERS:
            return np.nan, np.nan
        share, n = float(np.nanmean(flags)), float(np.isfinite(flags).sum())
        error = _standard_error(self._draw(flags)["bias"], n_markers)
        if 0.0 < share < 1.0:
            n = min(n, share * (1.0 - share) / error**2) if error > _ROUNDING else n
        else:
            n = n_markers
        return wilson(share * n, n, self.level)

    def _draw(self, errors: Array) -> dict[str, Array]:
        """(resamples,) of each of `STATISTICS`; NaN where one drew no fix."""
        drawn = [self._statistics(errors, *weights) for weights in self._weights(errors.shape)]
        return {
            name: np.concatenate([chunk[i] for chunk in drawn]) for i, name in enumerate(STATISTICS)
        }

    def _weights(self, shape: tuple[int, ...]) -> Iterator[tuple[Array, Array]]:
        """How often each resample draws each frame and marker, some resamples at a time."""
        frames, markers = shape
        # One generator each: what is drawn does not depend on how many are drawn at a time.
        of_frames, of_markers = np.random.default_rng(self.seed).spawn(2)
        step = max(1, _CHUNK // (frames * markers))
        for start in range(0, self.resamples, step):
            size = min(step, self.resamples - start)
            yield (
                of_frames.multinomial(frames, np.full(frames, 1 / frames), size).astype(np.float64),
                of_markers.multinomial(markers, np.full(markers, 1 / markers), size).astype(
                    np.float64
                ),
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


def _standard_error(values: Array, n_markers: int) -> float:
    """That of a statistic of so many markers, by its values in the resamples."""
    return float(np.sqrt(n_markers / (n_markers - 1)) * np.nanstd(values))


def wilson(successes: float, n: float, level: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a share of independent yes-or-no units; NaN without any."""
    if not n:
        return np.nan, np.nan
    z = float(stats.norm.ppf(0.5 + level / 2.0))
    share = successes / n
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return max(0.0, float(centre - half)), min(1.0, float(centre + half))
