"""Where the refinement of a subset starts: a homography or a DLT from sums over its markers.

A pose maps X (homogeneous, map frame) to the ray (x, y, 1) ~ P X. Written row by row, the linear
equations p1 X = x p3 X and p2 X = y p3 X have the normal matrix

    [ S    0   -Sx ]      S  = sum X X^T,       Sx = sum x X X^T,
    [ 0    S   -Sy ]      Sr = sum (x² + y²) X X^T,
    [ -Sx -Sy   Sr ]      Sy = sum y X X^T,

9x9 for a plane (X = (X, Y, 1)) and 12x12 in space. It is a sum over markers, so a subset costs a
few additions and no look at its points. The best p1 = S^-1 Sx p3 and p2 = S^-1 Sy p3 leave

    p3^T M p3 -> min,     M = Sr - Sx S^-1 Sx - Sy S^-1 Sy   (3x3 or 4x4).

With the origin at the centroid, the last element of p3 is the centroid's depth: it is set to 1 and
the others solve a linear system. Sources: Hartley & Zisserman, Multiple View Geometry, 4.1 and 7.1
(DLT); Zhang, PAMI 2000 (pose from a plane's homography, as OpenCV's `solvePnP` starts).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array

Function = TypeVar("Function", bound=Callable[..., Any])

# OpenCV's measure: the variance across the plane against the smaller one in it.
PLANE_VARIANCE_RATIO = 1e-3
# Position of each pair of homogeneous coordinates in the ten sums of a symmetric 4x4 matrix.
_AT = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]])


def compiled(function: Function) -> Function:
    """Machine code that runs without the interpreter lock.

    A compiled function calls only those of its own file: the cache notices no other file's change.
    """
    return cast(Function, numba.njit(cache=True, nogil=True)(function))


def marker_sums(points_m: Array, rays: Array) -> Array:
    """(N, 4, 10) sums S, Sx, Sy, Sr of each marker, upper triangles row by row.

    Args:
        points_m: (N, 4, 3) corners, best near the origin.
        rays: (N, 4, 2) their undistorted normalized image coordinates.
    """
    ones = np.ones((*points_m.shape[:2], 1))
    X = np.concatenate([points_m, ones], axis=2)
    weights = np.concatenate([ones, rays, (rays**2).sum(axis=2, keepdims=True)], axis=2)
    full = np.einsum("ncw,nci,ncj->nwij", weights, X, X)
    rows, columns = np.triu_indices(4)
    return np.ascontiguousarray(full[:, :, rows, columns])


@compiled
def _eigenbasis(A: Array, V: Array) -> None:
    """Eigenvectors of the symmetric (3, 3) A as rows of V, largest first, right-handed.

    A is overwritten, its eigenvalues on the diagonal. Cyclic Jacobi rotations (Golub & Van Loan,
    8.5).
    """
    for i in range(3):
        for j in range(3):
            V[i, j] = 1.0 if i == j else 0.0
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
    V[2, 0] = V[0, 1] * V[1, 2] - V[0, 2] * V[1, 1]
    V[2, 1] = V[0, 2] * V[1, 0] - V[0, 0] * V[1, 2]
    V[2, 2] = V[0, 0] * V[1, 1] - V[0, 1] * V[1, 0]


@compiled
def _plane_pose(W: Array, rotation: Array, translation: Array) -> bool:
    """The pose of the plane z = 0 from its homography; False where there is none.

    Args:
        W: (4, 4, 4) S, Sx, Sy, Sr about the centroid; of z nothing is used.
    """
    S, n = W[0], W[0, 3, 3]
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[0, 1]
    if not det > 1e-12 * (S[0, 0] + S[1, 1]) ** 2:
        return False
    inverse = ((S[1, 1] / det, -S[0, 1] / det), (-S[0, 1] / det, S[0, 0] / det))
    axes = (0, 1, 3)
    # T[w] = S^-1 Sx and S^-1 Sy, the columns of which give p1 and p2.
    T = np.empty((2, 3, 3))
    M = np.empty((3, 3))
    for w in range(2):
        for j in range(3):
            a, b = W[w + 1, 0, axes[j]], W[w + 1, 1, axes[j]]
            T[w, 0, j] = inverse[0][0] * a + inverse[0][1] * b
            T[w, 1, j] = inverse[1][0] * a + inverse[1][1] * b
            T[w, 2, j] = W[w + 1, 3, axes[j]] / n
    for i in range(2):
        for j in range(3):
            total = W[3, axes[i], axes[j]]
            for w in range(2):
                for k in range(3):
                    total -= W[w + 1, axes[i], axes[k]] * T[w, k, j]
            M[i, j] = total
    det = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    g, h = 0.0, 0.0
    if det > 0.0:
        g = (M[0, 1] * M[1, 2] - M[1, 1] * M[0, 2]) / det
        h = (M[1, 0] * M[0, 2] - M[0, 0] * M[1, 2]) / det
    H = np.empty((3, 3))
    for j in range(3):
        H[0, j] = T[0, j, 0] * g + T[0, j, 1] * h + T[0, j, 2]
        H[1, j] = T[1, j, 0] * g + T[1, j, 1] * h + T[1, j, 2]
    H[2, 0], H[2, 1], H[2, 2] = g, h, 1.0
    n0 = np.sqrt(H[0, 0] ** 2 + H[1, 0] ** 2 + H[2, 0] ** 2)
    n1 = np.sqrt(H[0, 1] ** 2 + H[1, 1] ** 2 + H[2, 1] ** 2)
    if not (n0 > 0.0 and n1 > 0.0):
        return False
    # The orthonormal pair nearest to two unit vectors is symmetric about their bisector.
    sum2, difference2 = 0.0, 0.0
    for i in range(3):
        a, b = H[i, 0] / n0, H[i, 1] / n1
        rotation[i, 0], rotation[i, 1] = a + b, a - b
        sum2 += (a + b) ** 2
        difference2 += (a - b) ** 2
    if not (sum2 > 1e-12 and difference2 > 1e-12):
        return False
    for i in range(3):
        c = rotation[i, 0] / np.sqrt(2.0 * sum2)
        d = rotation[i, 1] / np.sqrt(2.0 * difference2)
        rotation[i, 0], rotation[i, 1] = c + d, c - d
        translation[i] = H[i, 2] * 2.0 / (n0 + n1)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rotation[i, 2] = rotation[j, 0] * rotation[k, 1] - rotation[k, 0] * rotation[j, 1]
    return True


@compiled
def _space_pose(W: Array, rotation: Array, translation: Array) -> bool:
    """The pose of points in space by DLT; False where it is degenerate or a mirror image.

    Args:
        W: (4, 4, 4) S, Sx, Sy, Sr about the centroid, in axes that make S diagonal.
    """
    M = W[3].copy()
    for i in range(4):
        for j in range(4):
            for k in range(4):
                for w in range(1, 3):
                    M[i, j] -= W[w, i, k] * W[w, k, j] / W[0, k, k]
    A, b = M[:3, :3].copy(), -M[:3, 3].copy()
    for i in range(3):
        if not A[i, i] > 1e-14 * M[i, i]:
            return False
        for r in range(i + 1, 3):
            factor = A[r, i] / A[i, i]
            for c in range(i, 3):
                A[r, c] -= factor * A[i, c]
            b[r] -= factor * b[i]
    p3 = np.ones(4)
    for i in range(2, -1, -1):
        total = b[i]
        for c in range(i + 1, 3):
            total -= A[i, c] * p3[c]
        p3[i] = total / A[i, i]
    P = np.empty((3, 4))
    for j in range(4):
        P[2, j] = p3[j]
        for w in range(2):
            P[w, j] = 0.0
            for k in range(4):
                P[w, j] += W[w + 1, j, k] * p3[k] / W[0, j, j]
    R = P[:, :3].copy()
    # Newton's iteration R <- (R + R^-T) / 2 to the nearest rotation (Higham 1986), scaled first.
    size = 0.0
    for step in range(40):
        C = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                a, b1, c, d = (i + 1) % 3, (j + 1) % 3, (i + 2) % 3, (j + 2) % 3
                C[i, j] = R[a, b1] * R[c, d] - R[a, d] * R[c, b1]
        det = R[0, 0] * C[0, 0] + R[0, 1] * C[0, 1] + R[0, 2] * C[0, 2]
        if not det > 0.0:
            return False
        if step == 0:
            size = det ** (1.0 / 3.0)
            for i in range(3):
                for j in range(3):
                    R[i, j] /= size
            continue
        change = 0.0
        for i in range(3):
            for j in range(3):
                new = 0.5 * (R[i, j] + C[i, j] / det)
                change += abs(new - R[i, j])
                R[i, j] = new
        if change < 1e-13:
            break
    for i in range(3):
        translation[i] = P[i, 3] / size
        for j in range(3):
            rotation[i, j] = R[i, j]
    return True


@compiled
def starts(
    sums: Array,
    subsets: npt.NDArray[np.int64],
    flat: bool,
    poses: Array,
    normals: Array,
) -> None:
    """Fills in a start for each subset; NaN where there is none.

    Args:
        sums: (N, 4, 10) from `marker_sums`.
        subsets: (M, k) markers.
        flat: every marker lies in the plane z = 0.
        poses: (M, 2, 12) from a plane and, where the markers are in no plane, from DLT: rotation
            by rows, then the camera's coordinates of the centroid.
        normals: (M, 3) unit normal of the subset's plane.
    """
    W, V = np.empty((4, 4, 4)), np.empty((4, 4, 4))
    A, basis = np.empty((3, 3)), np.eye(3)
    rotation, translation = np.empty((3, 3)), np.empty(3)
    for m in range(len(subsets)):
        poses[m] = np.nan
        for w in range(4):
            for i in range(4):
                for j in range(i, 4):
                    total = 0.0
                    for marker in subsets[m]:
                        total += sums[marker, w, _AT[i, j]]
                    W[w, i, j] = total
        n = W[0, 3, 3]
        centre = (W[0, 0, 3] / n, W[0, 1, 3] / n, W[0, 2, 3] / n)
        for w in range(4):
            one = W[w, 3, 3]
            for i in range(3):
                for j in range(i, 3):
                    shift = centre[i] * W[w, j, 3] + centre[j] * W[w, i, 3]
                    W[w, i, j] += centre[i] * centre[j] * one - shift
            for i in range(3):
                W[w, i, 3] -= centre[i] * one
            for i in range(4):
                for j in range(i):
                    W[w, i, j] = W[w, j, i]
        plane = True
        if not flat:
            for i in range(3):
                for j in range(3):
                    A[i, j] = W[0, i, j]
            _eigenbasis(A, basis)
            plane = A[2, 2] < PLANE_VARIANCE_RATIO * A[1, 1]
            for w in range(4):
                for i in range(3):
                    for j in range(4):
                        V[w, i, j] = 0.0
                        for k in range(3):
                            V[w, i, j] += basis[i, k] * W[w, k, j]
                    V[w, 3, i] = V[w, i, 3]
                for i in range(3):
                    a, b, c = V[w, i, 0], V[w, i, 1], V[w, i, 2]
                    for j in range(3):
                        V[w, i, j] = basis[j, 0] * a + basis[j, 1] * b + basis[j, 2] * c
                V[w, 3, 3] = W[w, 3, 3]
            W[:] = V
        for i in range(3):
            normals[m, i] = basis[2, i]
        for start in range(1 if plane else 2):
            if start == 0:
                found = _plane_pose(W, rotation, translation)
            else:
                found = _space_pose(W, rotation, translation)
            if not found:
                continue
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for k in range(3):
                        total += rotation[i, k] * basis[k, j]
                    poses[m, start, 3 * i + j] = total
                poses[m, start, 9 + i] = translation[i]
