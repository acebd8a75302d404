"""Where the fit of a subset starts: a homography or a DLT from sums over its markers.

A pose maps a homogeneous point X to the ray (x, y, 1) ~ P X. The linear equations of P's rows,
p1 X = x p3 X and p2 X = y p3 X, have the normal matrix

    [  S    0  -Sx ]        S  = sum X X^T,      Sr = sum (x² + y²) X X^T,
    [  0    S  -Sy ]        Sx = sum x X X^T,    Sy = sum y X X^T,
    [ -Sx  -Sy  Sr ]

9x9 for a plane, X = (X, Y, 1), and 12x12 in space. It is a sum over markers: a subset costs a few
additions and no look at its corners. Given p3, the best p1 is S^-1 Sx p3 and the best p2 is
S^-1 Sy p3, which leaves

    p3^T M p3 -> min,       M = Sr - Sx S^-1 Sx - Sy S^-1 Sy    (3x3 or 4x4).

With the origin at the centroid the last element of p3 is the centroid's depth; it is set to 1, and
the others solve a linear system. The pose is then read from P.

Sources: Hartley & Zisserman, Multiple View Geometry, 4.1 and 7.1; Zhang, PAMI 2000 (a plane's pose
from its homography). OpenCV's `solvePnP(SOLVEPNP_ITERATIVE)` starts from the same two.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array

Function = TypeVar("Function", bound=Callable[..., Any])

# Variance across the plane against the smaller one in it, below which a subset is plane (OpenCV's).
PLANE_VARIANCE_RATIO = 1e-3
# Smaller standard deviation in the plane against the distance, below which a second pose of the
# plane may fit as well. One marker 15 cm wide is that small from 1.1 m on.
AMBIGUOUS_SPREAD = 0.07

# Where a pair of homogeneous coordinates is among the ten sums of a symmetric 4x4 matrix.
_AT = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]])
# The coordinates (X, Y, 1) of a plane among (X, Y, Z, 1).
_PLANE_AXES = (0, 1, 3)


def compiled(function: Function) -> Function:
    """Machine code that runs without the interpreter lock.

    A compiled function calls only those of its own file: the cache notices no other file's change.
    """
    return cast(Function, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def marker_sums(points_m: Array, rays: Array) -> Array:
    """(N, 4, 10) sums S, Sx, Sy, Sr of each marker, the upper triangles row by row.

    Args:
        points_m: (N, 4, 3) corners, with an origin near them.
        rays: (N, 4, 2) their undistorted normalized image coordinates.
    """
    ones = np.ones((*points_m.shape[:2], 1))
    X = np.concatenate([points_m, ones], axis=2)
    weights = np.concatenate([ones, rays, (rays**2).sum(axis=2, keepdims=True)], axis=2)
    full = np.einsum("ncw,nci,ncj->nwij", weights, X, X)
    rows, columns = np.triu_indices(4)
    return np.ascontiguousarray(full[:, :, rows, columns])


@compiled
def starts(
    sums: Array,
    subsets: npt.NDArray[np.int64],
    flat: bool,
    poses: Array,
    normals: Array,
    ambiguous: npt.NDArray[np.bool_],
) -> None:
    """Writes the starts of each subset.

    Args:
        sums: (N, 4, 10) from `marker_sums`.
        subsets: (M, k) markers.
        flat: every marker lies in the plane z = 0.
        poses: (M, 2, 12) of the plane and, where the corners are in no plane, of the DLT: the
            rotation by rows, then the centroid in the camera's frame. NaN where there is none.
        normals: (M, 3) unit normal of the subset's plane.
        ambiguous: (M,) another pose of the plane may fit as well.
    """
    W, V = np.empty((4, 4, 4)), np.empty((4, 4, 4))
    A, basis = np.empty((3, 3)), np.eye(3)
    rotation, translation = np.empty((3, 3)), np.empty(3)
    for m in range(len(subsets)):
        poses[m] = np.nan
        _centred(sums, subsets[m], W)
        plane = True
        if not flat:
            A[:] = W[0, :3, :3]
            _eigenbasis(A, basis)
            plane = A[2, 2] <= PLANE_VARIANCE_RATIO * A[1, 1]
            _turn(W, basis, V)
        normals[m] = basis[2]
        ambiguous[m] = False
        for start in range(1 if plane else 2):
            if start == 0:
                found = _plane_pose(W, rotation, translation)
            else:
                found = _space_pose(W, rotation, translation)
            if not found:
                continue
            if plane:
                mean = 0.5 * (W[0, 0, 0] + W[0, 1, 1])
                half = 0.5 * (W[0, 0, 0] - W[0, 1, 1])
                variance = (mean - np.sqrt(half**2 + W[0, 0, 1] ** 2)) / W[0, 3, 3]
                ambiguous[m] = variance < (AMBIGUOUS_SPREAD * translation[2]) ** 2
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for k in range(3):
                        total += rotation[i, k] * basis[k, j]
                    poses[m, start, 3 * i + j] = total
                poses[m, start, 9 + i] = translation[i]


@compiled
def _centred(sums: Array, subset: npt.NDArray[np.int64], W: Array) -> None:
    """W (4, 4, 4): S, Sx, Sy, Sr of a subset with the origin at its centroid."""
    for w in range(4):
        for i in range(4):
            for j in range(i, 4):
                total = 0.0
                for marker in subset:
                    total += sums[marker, w, _AT[i, j]]
                W[w, i, j] = total
    n = W[0, 3, 3]
    centre = (W[0, 0, 3] / n, W[0, 1, 3] / n, W[0, 2, 3] / n)
    for w in range(4):
        for i in range(3):
            for j in range(i, 3):
                shift = centre[i] * W[w, j, 3] + centre[j] * W[w, i, 3]
                W[w, i, j] += centre[i] * centre[j] * W[w, 3, 3] - shift
        for i in range(3):
            W[w, i, 3] -= centre[i] * W[w, 3, 3]
        for i in range(4):
            for j in range(i):
                W[w, i, j] = W[w, j, i]


@compiled
def _turn(W: Array, basis: Array, V: Array) -> None:
    """W in the axes that are the rows of `basis`; V (4, 4, 4) is scratch."""
    for w in range(4):
        for i in range(3):
            for j in range(4):
                V[w, i, j] = 0.0
                for k in range(3):
                    V[w, i, j] += basis[i, k] * W[w, k, j]
        for i in range(3):
            for j in range(3):
                W[w, i, j] = 0.0
                for k in range(3):
                    W[w, i, j] += V[w, i, k] * basis[j, k]
            W[w, i, 3] = W[w, 3, i] = V[w, i, 3]


@compiled
def _eigenbasis(A: Array, V: Array) -> None:
    """V (3, 3): unit eigenvectors of the symmetric A as rows, largest first, right-handed.

    A is overwritten; its eigenvalues end on its diagonal. Cyclic Jacobi rotations (Golub & Van
    Loan, Matrix Computations, 8.5).
    """
    V[:] = 0.0
    for i in range(3):
        V[i, i] = 1.0
    for _ in range(12):
        off = abs(A[0, 1]) + abs(A[0, 2]) + abs(A[1, 2])
        if off <= 1e-15 * (abs(A[0, 0]) + abs(A[1, 1]) + abs(A[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if A[p, q] == 0.0:
                    continue
                theta = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
                t = 1.0 / (abs(theta) + np.sqrt(1.0 + theta * theta))
                if theta < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = t * c
                for k in range(3):
                    a, b = A[k, p], A[k, q]
                    A[k, p], A[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = A[p, k], A[q, k]
                    A[p, k], A[q, k] = c * a - s * b, s * a + c * b
                    a, b = V[p, k], V[q, k]
                    V[p, k], V[q, k] = c * a - s * b, s * a + c * b
    for i in range(2):
        for j in range(2 - i):
            if A[j, j] < A[j + 1, j + 1]:
                A[j, j], A[j + 1, j + 1] = A[j + 1, j + 1], A[j, j]
                for k in range(3):
                    V[j, k], V[j + 1, k] = V[j + 1, k], V[j, k]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        V[2, i] = V[0, j] * V[1, k] - V[0, k] * V[1, j]


@compiled
def _plane_pose(W: Array, rotation: Array, translation: Array) -> bool:
    """The pose of the plane z = 0 by its homography; False where the corners give none.

    Args:
        W: (4, 4, 4) S, Sx, Sy, Sr about the centroid; what concerns z is not looked at.
    """
    S = W[0]
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[0, 1]
    if not det > 1e-12 * (S[0, 0] + S[1, 1]) ** 2:
        return False
    # T[0] = S^-1 Sx and T[1] = S^-1 Sy; S has no mixed terms with the constant coordinate.
    T, M = np.empty((2, 3, 3)), np.empty((3, 3))
    for w in range(2):
        for j in range(3):
            a, b, c = _PLANE_AXES[j], W[w + 1, 0, _PLANE_AXES[j]], W[w + 1, 1, _PLANE_AXES[j]]
            T[w, 0, j] = (S[1, 1] * b - S[0, 1] * c) / det
            T[w, 1, j] = (S[0, 0] * c - S[0, 1] * b) / det
            T[w, 2, j] = W[w + 1, 3, a] / S[3, 3]
    for i in range(3):
        for j in range(3):
            M[i, j] = W[3, _PLANE_AXES[i], _PLANE_AXES[j]]
            for w in range(2):
                for k in range(3):
                    M[i, j] -= W[w + 1, _PLANE_AXES[i], _PLANE_AXES[k]] * T[w, k, j]
    H = np.zeros((3, 3))
    H[2, 2] = 1.0
    det = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    # Without perspective the plane starts parallel to the image.
    if det > 0.0:
        H[2, 0] = (M[0, 1] * M[1, 2] - M[1, 1] * M[0, 2]) / det
        H[2, 1] = (M[1, 0] * M[0, 2] - M[0, 0] * M[1, 2]) / det
    for w in range(2):
        for j in range(3):
            for k in range(3):
                H[w, j] += T[w, j, k] * H[2, k]
    n0 = np.sqrt(H[0, 0] ** 2 + H[1, 0] ** 2 + H[2, 0] ** 2)
    n1 = np.sqrt(H[0, 1] ** 2 + H[1, 1] ** 2 + H[2, 1] ** 2)
    # The orthonormal pair nearest to two unit vectors lies evenly about their bisector.
    total, difference = 0.0, 0.0
    for i in range(3):
        a, b = H[i, 0] / n0, H[i, 1] / n1
        rotation[i, 0], rotation[i, 1] = a + b, a - b
        total += (a + b) ** 2
        difference += (a - b) ** 2
    if not (total > 1e-12 and difference > 1e-12):
        return False
    for i in range(3):
        a, b = rotation[i, 0] / np.sqrt(2.0 * total), rotation[i, 1] / np.sqrt(2.0 * difference)
        rotation[i, 0], rotation[i, 1] = a + b, a - b
        translation[i] = H[i, 2] * 2.0 / (n0 + n1)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rotation[i, 2] = rotation[j, 0] * rotation[k, 1] - rotation[k, 0] * rotation[j, 1]
    return True


@compiled
def _space_pose(W: Array, rotation: Array, translation: Array) -> bool:
    """The pose of corners in space by DLT; False where it is degenerate or a mirror image.

    Args:
        W: (4, 4, 4) S, Sx, Sy, Sr about the centroid, in axes that make S diagonal.
    """
    M = W[3].copy()
    for i in range(4):
        for j in range(4):
            for k in range(4):
                M[i, j] -= (W[1, i, k] * W[1, k, j] + W[2, i, k] * W[2, k, j]) / W[0, k, k]
    P = np.zeros((3, 4))
    P[2, 3] = 1.0
    for i in range(3):
        pivot = M[i, i]
        if not pivot > 0.0:
            return False
        for r in range(i + 1, 3):
            factor = M[r, i] / pivot
            for c in range(i, 4):
                M[r, c] -= factor * M[i, c]
    for i in range(2, -1, -1):
        total = -M[i, 3]
        for c in range(i + 1, 3):
            total -= M[i, c] * P[2, c]
        P[2, i] = total / M[i, i]
    for w in range(2):
        for j in range(4):
            for k in range(4):
                P[w, j] += W[w + 1, j, k] * P[2, k] / W[0, j, j]
    # Newton's iteration R <- (R + R^-T) / 2 to the nearest rotation (Higham 1986).
    rotation[:] = P[:, :3]
    scale = 1.0
    C = np.empty((3, 3))
    for step in range(40):
        for i in range(3):
            for j in range(3):
                a, b, c, d = (i + 1) % 3, (j + 1) % 3, (i + 2) % 3, (j + 2) % 3
                C[i, j] = rotation[a, b] * rotation[c, d] - rotation[a, d] * rotation[c, b]
        det = rotation[0, 0] * C[0, 0] + rotation[0, 1] * C[0, 1] + rotation[0, 2] * C[0, 2]
        if not det > 0.0:
            return False
        if step == 0:
            scale = det ** (-1.0 / 3.0)
            rotation *= scale
            continue
        change = 0.0
        for i in range(3):
            for j in range(3):
                new = 0.5 * (rotation[i, j] + C[i, j] / det)
                change += abs(new - rotation[i, j])
                rotation[i, j] = new
        if change < 1e-13:
            break
    for i in range(3):
        translation[i] = P[i, 3] * scale
    return True
