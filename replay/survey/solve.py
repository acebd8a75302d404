"""Solves a bundle adjustment with a robust loss and the corner noise that the data show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import LinearOperator

from pipeline.geometry import Array
from replay.survey.normal import NormalEquations
from replay.survey.problem import Problem

Loss = Literal["linear", "soft_l1", "huber", "cauchy"]

# Where each loss leaves the parabola, in standard deviations: about 95 % as good as least squares
# where all noise is Gaussian.
LOSS_SCALE: dict[Loss, float] = {"linear": 1.0, "soft_l1": 2.0, "huber": 1.345, "cauchy": 2.385}

# The noise is measured anew in each round, from that of the rough map down.
_ROUNDS = 12
_SETTLED = 0.01
# Corners without any noise still have a weight.
_SIGMA_FLOOR_PX = 1e-4


@dataclass(frozen=True, eq=False)
class Solution:
    """Attributes:
    x: the problem's parameters.
    sigma_px: standard deviation of a corner's u or v.
    dependence: by how much corners weighed less than as independent draws, in variance.
    weights: (residuals,) of the robust loss, 1 where it is the parabola.
    converged: whether the noise settled and the last round came to its end.
    """

    x: Array
    sigma_px: float
    dependence: float
    weights: Array
    converged: bool


def solve(problem: Problem, x: Array, loss: Loss, dependence: float = 1.0) -> Solution:
    """The parameters with the least loss, from `x`, with the noise that they leave.

    Args:
        dependence: by how much corners weigh less than as independent draws, in variance.

    Raises:
        numpy.linalg.LinAlgError: something is not determined.
    """
    sigma_px = corner_sigma_px(problem, x)
    converged = False
    for _ in range(_ROUNDS):
        x, ended = _minimize(problem, x, loss, sigma_px, dependence)
        before, sigma_px = sigma_px, corner_sigma_px(problem, x)
        if abs(sigma_px - before) <= _SETTLED * sigma_px:
            converged = ended
            break
    residuals = problem.residuals(x, sigma_px * np.sqrt(dependence))
    weights = robust_weights(problem, residuals, loss, dependence)
    return Solution(x, sigma_px, dependence, weights, converged)


def corner_sigma_px(problem: Problem, x: Array) -> float:
    """Standard deviation of a corner's u or v from the median absolute error.

    As if it were Gaussian, and made up for the parameters that have bent towards the noise.
    """
    errors = np.abs(problem.corner_errors_px(x)).ravel()
    freedom = max(len(errors) - problem.size, 1) / len(errors)
    sigma_px = 1.4826 * float(np.median(errors)) / np.sqrt(freedom)
    return float(max(sigma_px, _SIGMA_FLOOR_PX))


def robust_weights(problem: Problem, residuals: Array, loss: Loss, dependence: float) -> Array:
    """The derivative of the loss by half the squared residual."""
    return np.asarray(_loss(problem, loss, dependence)(residuals**2)[1])


def _loss(problem: Problem, loss: Loss, dependence: float) -> Callable[[Array], Array]:
    """rho(squares) and its first two derivatives (3, residuals), as scipy takes them.

    Corners' residuals are `dependence` times too small, in variance, for what is far off.
    """
    scale = np.full(problem.corner_rows + problem.frame_start, LOSS_SCALE[loss] ** 2)
    scale[: problem.corner_rows] /= dependence

    def rho(squares: Array) -> Array:
        z = squares / scale
        if loss == "soft_l1":
            root = np.sqrt(1.0 + z)
            parts = [2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3]
        elif loss == "huber":
            root = np.sqrt(np.maximum(z, 1.0))
            parts = [np.where(z > 1.0, 2.0 * root - 1.0, z), 1.0 / root]
            parts.append(np.where(z > 1.0, -0.5 / root**3, 0.0))
        elif loss == "cauchy":
            parts = [np.log1p(z), 1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2]
        else:
            parts = [z, np.ones_like(z), np.zeros_like(z)]
        return np.stack([scale * parts[0], parts[1], parts[2] / scale])

    return rho


def weighted_jacobian(problem: Problem, x: Array, weight_px: float, weights: Array) -> csr_array:
    """The Jacobian of residuals times the root of their weights."""
    return (diags_array(np.sqrt(weights)) @ problem.jacobian(x, weight_px)).tocsr()


def _minimize(
    problem: Problem, x: Array, loss: Loss, sigma_px: float, dependence: float
) -> tuple[Array, bool]:
    """The least loss for a known noise, and whether it came to an end."""
    weight_px = sigma_px * float(np.sqrt(dependence))
    weights = robust_weights(problem, problem.residuals(x, weight_px), loss, dependence)
    factors = NormalEquations(
        weighted_jacobian(problem, x, weight_px, weights), problem.frame_start
    )

    # In parameters y with x + U⁻¹ y, J is nearly orthonormal, and LSMR done after a few steps.
    def residuals(y: Array) -> Array:
        return problem.residuals(x + factors.apply(y), weight_px)

    def jacobian(y: Array) -> LinearOperator:
        rows = problem.jacobian(x + factors.apply(y), weight_px)
        columns = rows.T.tocsr()
        return LinearOperator(
            rows.shape,
            matvec=lambda v: rows @ factors.apply(np.ravel(v)),
            rmatvec=lambda v: factors.apply_transposed(columns @ np.ravel(v)),
            dtype=np.float64,
        )

    found = least_squares(
        residuals,
        np.zeros(problem.size),
        jacobian,
        method="trf",
        tr_solver="lsmr",
        loss=_loss(problem, loss, dependence),
        # The first step may be as long as a thousand standard deviations.
        x_scale=1000.0,
        ftol=1e-10,
        xtol=1e-12,
        gtol=1e-10,
        max_nfev=60,
    )
    return x + factors.apply(found.x), bool(found.status > 0)
