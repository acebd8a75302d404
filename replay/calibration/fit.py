"""The least squares: lens and board poses together, with honest uncertainties.

OpenCV's `calibrateCamera` minimizes the same sum and finds the same minimum; it has neither a
robust loss nor standard deviations for fisheye lenses, and says nothing about how views agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Array
from replay.calibration.lens import Lens
from replay.calibration.views import View

_MOST_STEPS = 200
_DAMPING = 1e-3
_DAMPING_LIMITS = (1e-12, 1e12)
# In units of the noise's variance; a hundredth of a standard deviation is worth no further step.
_SMALL_DECREASE = 1e-4
_SMALL_STEP = 1e-10


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters of a lens with the pose of the board in each view.

    Attributes:
        values: (P,) in the order of `lens.names`.
        poses: (V, 6) axis-angle and translation of T_camera_board.
        residuals: (N, 2) of each view, found minus projected, pixels.
        information: (F, F) of the free parameters with the poses eliminated, for noise of 1 px.
        by_view: (V, F, F) each view's share of it.
        gradients: (V, F) each view's share of the gradient, which is zero in sum.
    """

    lens: Lens
    values: Array
    poses: Array
    residuals: tuple[Array, ...]
    information: Array
    by_view: Array
    gradients: Array

    @property
    def rms_px(self) -> float:
        return rms(np.vstack(self.residuals))

    @property
    def view_rms_px(self) -> Array:
        """(V,) of each view."""
        return np.array([rms(residuals) for residuals in self.residuals])

    @property
    def sigma_px(self) -> float:
        """Noise of one coordinate of a corner: what is left, over the degrees of freedom."""
        squares = float(sum(np.sum(residuals**2) for residuals in self.residuals))
        count = sum(residuals.size for residuals in self.residuals)
        freedom = count - int(self.lens.free.sum()) - self.poses.size
        return float(np.sqrt(squares / max(freedom, 1)))

    @property
    def covariance(self) -> Array:
        """(P, P) if corner errors are independent; zero for what is held at zero."""
        return self._spread(self.sigma_px**2 * _inverse(self.information))

    @property
    def covariance_by_views(self) -> Array:
        """(P, P) from how the parameters move as one view after the other is left out.

        The jackknife: errors within a view may go together (a board that is not flat). Each step
        is one of Newton's from the common minimum.
        """
        count = len(self.poses)
        moves = np.stack(
            [
                _inverse(self.information - own) @ gradient
                for own, gradient in zip(self.by_view, self.gradients, strict=True)
            ]
        )
        moves -= moves.mean(axis=0)
        return self._spread((count - 1) / count * moves.T @ moves)

    def _spread(self, of_free: Array) -> Array:
        covariance = np.zeros((len(self.values), len(self.values)))
        free = np.flatnonzero(self.lens.free)
        covariance[np.ix_(free, free)] = of_free
        return covariance


def rms(residuals: Array) -> float:
    """Root of the mean squared distance, as OpenCV counts it: x and y of a point together."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


def fit_lens(
    lens: Lens,
    views: Sequence[View],
    values: Array,
    poses: Array,
    *,
    loss_px: float | None = None,
    most_steps: int = _MOST_STEPS,
) -> Fit:
    """The minimum that is downhill from `values` and `poses`.

    Args:
        values: (P,) of which those that are not free stay.
        poses: (V, 6).
        loss_px: Cauchy's loss of this scale, which forgets views that fit nowhere; None: squares.

    Raises:
        ValueError: the start has a board behind the camera.

    Source: Triggs et al., Bundle Adjustment, A Modern Synthesis, 2000: Levenberg's and Marquardt's
    steps by the Schur complement of the poses.
    """
    system = _System.at(lens, views, values, poses, loss_px)
    if system is None:
        raise ValueError("expected every board before the camera")
    damping = _DAMPING
    for _ in range(most_steps):
        step, pose_steps = system.step(damping)
        moved = values.copy()
        moved[lens.free] += step
        after = _System.at(lens, views, moved, poses + pose_steps, loss_px)
        if after is None or not after.cost < system.cost:
            damping *= 10
            if damping > _DAMPING_LIMITS[1] or _still(step, system):
                break
            continue
        decrease = system.cost - after.cost
        values, poses = moved, poses + pose_steps
        still = decrease <= _SMALL_DECREASE * system.cost / system.count
        system = after
        damping = max(damping / 10, _DAMPING_LIMITS[0])
        if still or system.cost == 0:
            break
    information, gradients = system.eliminated()
    return Fit(
        lens,
        values,
        poses,
        tuple(system.residuals),
        np.asarray(information.sum(axis=0)),
        information,
        gradients,
    )


def fit_pose(lens: Lens, values: Array, view: View, start: Array) -> Array | None:
    """(6,) the pose downhill from `start` with the lens as it is; None with a point behind it."""
    pose = start
    held = Lens(lens.model)
    damping, cost = _DAMPING, np.inf
    projected = held.project(values, pose, view.points_m)
    if projected is None:
        return None
    for _ in range(_MOST_STEPS):
        residual = (view.pixels - projected[0]).ravel()
        cost = float(residual @ residual)
        jacobian = projected[2]
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        while True:
            damped = normal + damping * np.diag(np.diag(normal))
            moved = pose + np.linalg.solve(damped, gradient)
            after = held.project(values, moved, view.points_m)
            lower = after is not None and np.sum((view.pixels - after[0]) ** 2) < cost
            if lower or damping > _DAMPING_LIMITS[1]:
                break
            damping *= 10
        if not lower or after is None:
            return pose
        change = cost - float(np.sum((view.pixels - after[0]) ** 2))
        pose, projected, damping = moved, after, max(damping / 10, _DAMPING_LIMITS[0])
        if change <= _SMALL_DECREASE * cost / residual.size:
            break
    return pose


def _inverse(information: Array) -> Array:
    """The inverse; infinite where the views say nothing about a parameter.

    By way of a unit diagonal, and with eigenvalues no smaller than what rounding leaves of them:
    coefficients of a rational lens may trade against each other nearly without end.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not ((scale > 0).all() and np.isfinite(information).all()):
        return np.full_like(information, np.inf)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    least = len(values) * np.finfo(np.float64).eps * values[-1]
    inverse = (vectors / np.maximum(values, least)) @ vectors.T
    return np.asarray(inverse / np.outer(scale, scale))


def _still(step: Array, system: _System) -> bool:
    """The step is below what the numbers can tell."""
    sizes = np.sqrt(np.diag(system.a.sum(axis=0)))
    return bool(np.abs(step * sizes).max(initial=0.0) <= _SMALL_STEP * np.sqrt(system.count))


@dataclass(frozen=True, eq=False)
class _System:
    """The normal equations, view by view: [a b; b' c] with the right side [g; h]."""

    cost: float
    count: int
    residuals: list[Array]
    a: Array
    b: Array
    c: Array
    g: Array
    h: Array

    @classmethod
    def at(
        cls,
        lens: Lens,
        views: Sequence[View],
        values: Array,
        poses: Array,
        loss_px: float | None,
    ) -> _System | None:
        free = lens.free
        if not (np.isfinite(values).all() and np.isfinite(poses).all() and (values[:2] > 0).all()):
            return None
        cost, residuals, rows = 0.0, [], []
        for view, pose in zip(views, poses, strict=True):
            projected = lens.project(values, pose, view.points_m)
            if projected is None:
                return None
            pixels, by_values, by_pose = projected
            residual = view.pixels - pixels
            squares = np.sum(residual**2, axis=1)
            weights = np.ones(len(squares))
            if loss_px is not None:
                weights = 1 / (1 + squares / loss_px**2)
                cost += float(loss_px**2 * np.sum(np.log1p(squares / loss_px**2)))
            else:
                cost += float(squares.sum())
            root = np.repeat(np.sqrt(weights), 2)
            jacobian = np.hstack([by_values[:, free], by_pose]) * root[:, None]
            rows.append((jacobian.T @ jacobian, jacobian.T @ (residual.ravel() * root)))
            residuals.append(residual)
        if not np.isfinite(cost):
            return None
        count = int(free.sum())
        normal = np.stack([row[0] for row in rows])
        right = np.stack([row[1] for row in rows])
        return cls(
            cost,
            sum(residual.size for residual in residuals),
            residuals,
            normal[:, :count, :count],
            normal[:, :count, count:],
            normal[:, count:, count:],
            right[:, :count],
            right[:, count:],
        )

    def step(self, damping: float) -> tuple[Array, Array]:
        """The damped step of the parameters (F,) and the poses (V, 6)."""
        a = self.a.sum(axis=0)
        a = a + damping * np.diag(np.diag(a))
        c = self.c + damping * self.c * np.eye(6)
        by_c = np.linalg.solve(c, np.swapaxes(self.b, 1, 2))
        h_by_c = np.linalg.solve(c, self.h[:, :, None])[:, :, 0]
        schur = a - np.einsum("vij,vjk->ik", self.b, by_c)
        right = self.g.sum(axis=0) - np.einsum("vij,vj->i", self.b, h_by_c)
        scale = np.sqrt(np.maximum(np.diag(a), np.finfo(float).tiny))
        solution = np.linalg.lstsq(schur / np.outer(scale, scale), right / scale, rcond=None)[0]
        step = solution / scale
        return step, h_by_c - np.einsum("vij,j->vi", by_c, step)

    def eliminated(self) -> tuple[Array, Array]:
        """Information (V, F, F) and gradient (V, F) of the parameters, the poses eliminated."""
        by_c = np.linalg.solve(self.c, np.swapaxes(self.b, 1, 2))
        h_by_c = np.linalg.solve(self.c, self.h[:, :, None])[:, :, 0]
        information = self.a - np.einsum("vij,vjk->vik", self.b, by_c)
        return information, self.g - np.einsum("vij,vj->vi", self.b, h_by_c)
