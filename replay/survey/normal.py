"""The normal equations of a bundle adjustment, with the frames eliminated."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.sparse import bsr_array, csr_array

from pipeline.geometry import Array


class NormalEquations:
    """H = JᵀJ, factored: frames, which see no other frame, first, then all that they share.

    Args:
        jacobian: of residuals over their standard deviations, robust weights applied.
        shared: how many parameters come before the frames, of which each has six.

    Raises:
        numpy.linalg.LinAlgError: something is not determined.
    """

    def __init__(self, jacobian: csr_array, shared: int) -> None:
        self.shared = shared
        whole = (jacobian.T @ jacobian).tocsr()
        own = whole[shared:, shared:].tobsr((6, 6))
        own.sort_indices()
        # Upper triangular factors U with UᵀU = H.
        upper = np.linalg.cholesky(own.data).mT
        inverse = np.linalg.inv(upper)
        frames = len(inverse)
        place = (np.arange(frames), np.arange(frames + 1))
        self._frame_inverse = bsr_array((inverse, *place), shape=own.shape).tocsr()
        coupling = whole[shared:, :shared]
        self._back = self._frame_inverse.T @ coupling
        reduced = whole[:shared, :shared].toarray() - (self._back.T @ self._back).toarray()
        self._upper = cholesky(reduced)

    def inverse(self) -> Array:
        """(shared, shared) of H⁻¹: the shared parameters' covariance, whatever the frames are."""
        return np.asarray(cho_solve((self._upper, False), np.eye(self.shared)))

    def information(self) -> Array:
        """(shared, shared) inverse of `inverse`."""
        return np.asarray(self._upper.T @ self._upper)

    def apply(self, y: Array) -> Array:
        """U⁻¹ y with UᵀU = H: parameters from those in which H is the identity."""
        shared = self.apply_shared(y[: self.shared])
        return np.concatenate(
            [shared, self._frame_inverse @ (y[self.shared :] - self._back @ shared)]
        )

    def apply_shared(self, y: Array) -> Array:
        """The shared parameters of `apply`, which need those of `y` only."""
        return np.asarray(solve_triangular(self._upper, y))

    def apply_transposed(self, x: Array) -> Array:
        """U⁻ᵀ x; `x` may have columns."""
        frames = self._frame_inverse.T @ x[self.shared :]
        shared = x[: self.shared] - self._back.T @ frames
        return np.concatenate([solve_triangular(self._upper, shared, trans="T"), frames])
