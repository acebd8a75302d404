"""Whether a filter's covariances are as large as its errors are.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
section 5.4: tests of innovations (NIS, whiteness) from one run, and of errors (NEES).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from pipeline.geometry import Array

Verdict = Literal["overconfident", "underconfident", "consistent"]

# Two-sided, of all intervals here.
CONFIDENCE = 0.95

# Of one fix, and of one position: x and y.
DOF = 2


@dataclass(frozen=True)
class NisTest:
    """Mean normalized innovation squared; 2 where the filter's model is true.

    Attributes:
        low, high: where the mean is expected: the chi-square of n·2 degrees of freedom, over n.
    """

    n: int
    mean: float
    low: float
    high: float

    @property
    def verdict(self) -> Verdict:
        return nis_verdict(self.mean, self.low, self.high)


def nis_verdict(mean: float, low: float, high: float) -> Verdict:
    """Overconfident: the innovations are larger than the filter believed they would be."""
    if mean > high:
        return "overconfident"
    return "underconfident" if mean < low else "consistent"


def nis_test(nis: Array) -> NisTest:
    """The mean of the updates' NIS with its band.

    Raises:
        ValueError: there is no finite value.
    """
    values = nis[np.isfinite(nis)]
    n = len(values)
    if not n:
        raise ValueError("expected at least one update, found none")
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = stats.chi2.ppf([tail, 1.0 - tail], n * DOF) / n
    return NisTest(n, float(values.mean()), float(low), float(high))


def nees(error_m: Array, variance_m2: Array) -> Array:
    """(N,) normalized error squared of the position; its mean is 2 where the covariance is true.

    x and y of this filter are independent of each other: their variances are all there is.

    Args:
        error_m, variance_m2: (N, 2).
    """
    return np.asarray((error_m**2 / variance_m2).sum(axis=1), dtype=np.float64)


def lag1(innovation_m: Array, innovation_var_m2: Array) -> Array:
    """(2,) normalized autocorrelation of each axis' innovations from one update to the next.

    The mean is not taken off (it should be zero, and a bias is a defect too); the innovations are
    divided by their σ, which changes from fix to fix. White ones give 0 within 1.96/√n; NaN where
    an axis has no innovations but zeros.

    Args:
        innovation_m, innovation_var_m2: (n, 2) of updates that follow each other.
    """
    standard = innovation_m / np.sqrt(innovation_var_m2)
    before, after = standard[:-1], standard[1:]
    scale = np.sqrt((before**2).sum(axis=0) * (after**2).sum(axis=0))
    scale[scale == 0.0] = np.nan
    return np.asarray((before * after).sum(axis=0) / scale, dtype=np.float64)


def lag1_band(n: int) -> float:
    """Half the width of the band around 0 for `n` pairs of white innovations."""
    return float(stats.norm.ppf((1.0 + CONFIDENCE) / 2.0) / np.sqrt(n))


def log_likelihood(innovation_m: Array, innovation_var_m2: Array) -> Array:
    """(n,) log density (m⁻²) of each innovation under N(0, S): what the filter says of the data."""
    squares = innovation_m**2 / innovation_var_m2
    return np.asarray(
        -0.5 * (np.log(2.0 * np.pi * innovation_var_m2) + squares).sum(axis=1), dtype=np.float64
    )
