"""How sure the refined markers are: noise, what it has in common over time, and lasting bias.

A detector's corners are not independent draws. Noise goes on from frame to frame while a corner
keeps its place among the pixels, and each marker's corners are off in a way of their own, from its
pattern, its print, its light. Frames average out neither. Both show in the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array

from pipeline.geometry import Array
from replay.survey.normal import NormalEquations
from replay.survey.problem import IntArray, Problem
from replay.survey.solve import Solution, weighted_jacobian

# A variance does not need more markers to be estimated from.
_MARKERS_FOR_BIAS = 100
_LONGEST_LAG = 50
_LEAST_CORRELATION = 0.05


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Attributes:
    covariance: (shared, shared) of the free markers' shifts and turns, and of the edges' inset.
    correlation: how many frames in a row count as one.
    bias_px: standard deviation of each marker corner's own lasting error, in u and in v.
    dependence: how many views of a marker tell as much as one, were they independent.
    """

    covariance: Array
    correlation: float
    bias_px: float
    dependence: float


def uncertainty(problem: Problem, solution: Solution) -> Uncertainty:
    """The covariance of a solution, with the correlation and the bias that its residuals show.

    Raises:
        numpy.linalg.LinAlgError: something is not determined.
    """
    weight_px = solution.sigma_px * float(np.sqrt(solution.dependence))
    rows = weighted_jacobian(problem, solution.x, weight_px, solution.weights)
    factors = NormalEquations(rows, problem.frame_start)
    roots = np.sqrt(solution.weights)
    residuals = (roots * problem.residuals(solution.x, weight_px))[: problem.corner_rows]
    patterns = _patterns(problem, roots[: problem.corner_rows] / weight_px)
    corners = rows[: problem.corner_rows]

    # The mean error of each marker corner, along the marker's axes.
    own = (patterns.T @ patterns).tobsr((2, 2))
    solver = bsr_array((np.linalg.inv(own.data), own.indices, own.indptr), shape=own.shape).tocsr()
    mean = solver @ (patterns.T @ residuals)
    correlation = _correlation(problem, residuals - patterns @ mean)
    seen = factors.apply_transposed((corners.T @ patterns).toarray())
    chosen = _most_seen(problem)
    # How much of a lasting error is left in the mean, and how much noise there is in it.
    left = np.eye(len(chosen)) - solver[chosen][:, chosen] @ (seen[:, chosen].T @ seen[:, chosen])
    variance = correlation / solution.dependence
    noise = variance * float(np.trace(left @ solver[chosen][:, chosen].toarray()))
    excess = float(mean[chosen] @ mean[chosen]) - noise
    bias_px = np.sqrt(max(excess, 0.0) / float((left**2).sum()))

    inverse = factors.inverse()
    prior = np.diag(roots[problem.corner_rows :] ** 2 / problem.prior_std**2)
    middle = variance * (factors.information() - prior) + prior
    from_bias = bias_px * factors.apply_shared(seen[: problem.frame_start])
    covariance = inverse @ middle @ inverse + from_bias @ from_bias.T
    # A marker's mean corner is off by the noise over its views and by its lasting error.
    views = len(problem.observations) / len(problem.markers)
    dependence = correlation + views * (bias_px / solution.sigma_px) ** 2
    return Uncertainty(covariance, correlation, float(bias_px), float(dependence))


def _patterns(problem: Problem, scale: Array) -> csr_array:
    """(8 N, 8 M): what an error of one pixel along a marker's own edges does to the residuals.

    Eight columns for each marker: along its x and its y axis in the image, for each corner.
    """
    observations = problem.observations
    top_left, top_right, bottom_right, bottom_left = observations.corners_px.swapaxes(0, 1)
    across = (top_right - top_left) + (bottom_right - bottom_left)
    down = (bottom_left - top_left) + (bottom_right - top_right)
    axes = np.stack([across, down], axis=2)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    count = len(observations)
    values = np.broadcast_to(axes[:, None], (count, 4, 2, 2)) * scale.reshape(count, 4, 2, 1)
    columns = (
        8 * observations.marker[:, None, None, None]
        + 2 * np.arange(4)[:, None, None]
        + np.arange(2)
        + np.zeros((2, 1), dtype=np.int64)
    )
    pointers = np.arange(0, 16 * count + 1, 2)
    shape = (8 * count, 8 * len(problem.markers))
    return csr_array((values.ravel(), columns.ravel(), pointers), shape=shape)


def _most_seen(problem: Problem) -> IntArray:
    """The patterns' columns of the markers that are seen most."""
    counts = np.bincount(problem.observations.marker, minlength=len(problem.markers))
    markers = np.sort(np.argsort(-counts, kind="stable")[:_MARKERS_FOR_BIAS])
    return np.asarray((8 * markers[:, None] + np.arange(8)).ravel())


def _correlation(problem: Problem, residuals: Array) -> float:
    """By how much a mean over frames is worse than one of independent draws, in variance.

    One and twice the sum of the autocorrelation over the frames that see a marker.
    """
    frames, markers = problem.observations.frame, problem.observations.marker
    order = np.lexsort((frames, markers))
    series = residuals.reshape(-1, 8)[order]
    owner = markers[order]
    variance = float((series**2).mean())
    if variance == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, min(_LONGEST_LAG, len(series) - 1) + 1):
        same = owner[lag:] == owner[:-lag]
        if not same.any():
            break
        correlation = float((series[lag:] * series[:-lag])[same].mean()) / variance
        if correlation < _LEAST_CORRELATION:
            break
        total += 2.0 * correlation
    return total
