"""Least squares of the reprojection error by Levenberg-Marquardt, one subset after another.

The cost is OpenCV's: the sum over corners of |project(R (X - c) + t) - u|² in distorted pixels; c
is the centroid of the subset, which uncouples R from t. A step (w, d) turns R into R(w) R, R(w)
a rotation by w to second order, and adds d to t. With Q = R (X - c), P = Q + t and p the derivative
of a pixel coordinate by P, its derivative by the step is (Q x p, p). H = J^T J and g = J^T r are
summed corner by corner in a loop that the compiler vectorizes.

Gauss-Newton converges linearly where residuals are large against what the geometry determines
(two markers seen from the front: by a factor of 0.5 or worse a step). A fit that is slow goes on
with Newton's steps, whose matrix comes from differences of g.

Sources: Moré 1978 (damping scaled by the diagonal of H); OpenCV's camera model (`projectPoints`);
Schweighofer & Pinz, PAMI 2006 (the two poses of a plane).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array

Function = TypeVar("Function", bound=Callable[..., Any])

GAUSS_NEWTON_STEPS = 8
MAX_STEPS = 50
# A step that promises less than this share of the cost, or this many px², is the last one. In
# position that is below 1e-4 standard deviations.
RELATIVE_TOLERANCE = 1e-9
ABSOLUTE_TOLERANCE = 1e-13
# Damping after the first failure, and where it ends as hopeless.
_FIRST_DAMPING, _LAST_DAMPING = 1e-3, 1e9
# Two costs of one minimum differ by less than this share.
_SAME_COST = 1e-6
# Radians, and shares of the distance: the differences that make Newton's matrix.
_DIFFERENCE = 1e-6

# Sums may be reordered (so that they vectorize); infinity and NaN keep their meaning.
_FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


def compiled(function: Function, inline: Literal["never", "always"] = "never") -> Function:
    """Machine code that runs without the interpreter lock.

    A compiled function calls only those of its own file: the cache notices no other file's change.
    Dividing by zero gives infinity: a check for it would keep a loop from being vectorized.
    """
    compiler = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline=inline
    )
    return cast(Function, compiler(function))


def inlined(function: Function) -> Function:
    """Like `compiled`, and put into the loops that call it, so that they can be vectorized."""
    return compiled(function, "always")


@inlined
def project(x: float, y: float, lens: Array) -> tuple[float, float, float, float, float, float]:
    """The pixel (u, v) of the ray (x, y, 1) and its derivatives ux, uy, vx, vy.

    Args:
        lens: (16,) fx, fy, cx, cy, then OpenCV's k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.
    """
    fx, fy = lens[0], lens[1]
    k1, k2, p1, p2, k3, k4, k5, k6 = (
        lens[4], lens[5], lens[6], lens[7], lens[8], lens[9], lens[10], lens[11],
    )  # fmt: skip
    s1, s2, s3, s4 = lens[12], lens[13], lens[14], lens[15]
    q = x * x + y * y
    # radial = (1 + k1 q + k2 q² + k3 q³) / (1 + k4 q + k5 q² + k6 q³), and its slope in q.
    share = 1.0 / (1.0 + q * (k4 + q * (k5 + q * k6)))
    radial = (1.0 + q * (k1 + q * (k2 + q * k3))) * share
    slope = (
        k1 + q * (2.0 * k2 + q * 3.0 * k3) - radial * (k4 + q * (2.0 * k5 + q * 3.0 * k6))
    ) * share
    xd = x * radial + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x) + q * (s1 + q * s2)
    yd = y * radial + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y + q * (s3 + q * s4)
    prism_x, prism_y = 2.0 * (s1 + 2.0 * s2 * q), 2.0 * (s3 + 2.0 * s4 * q)
    mixed = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return (
        fx * xd + lens[2],
        fy * yd + lens[3],
        fx * (radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x),
        fx * (mixed + prism_x * y),
        fy * (mixed + prism_y * x),
        fy * (radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y),
    )


@compiled
def normal_equations(points: Array, pose: Array, lens: Array, out: Array) -> float:
    """The cost of a pose in px²; infinite where a corner is behind the camera.

    Args:
        points: (5, n) x, y, z from the centroid in metres; u, v in pixels.
        pose: (12,) the rotation by rows, the translation.
        out: (27,) g, then the upper triangle of H row by row.
    """
    xs, ys, zs, us, vs = points[0], points[1], points[2], points[3], points[4]
    r00, r01, r02, r10, r11, r12 = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    r20, r21, r22, t0, t1, t2 = pose[6], pose[7], pose[8], pose[9], pose[10], pose[11]
    cost = 0.0
    behind = 0
    g0 = g1 = g2 = g3 = g4 = g5 = 0.0
    h00 = h01 = h02 = h03 = h04 = h05 = h11 = h12 = h13 = h14 = h15 = 0.0
    h22 = h23 = h24 = h25 = h33 = h34 = h35 = h44 = h45 = h55 = 0.0
    for i in range(points.shape[1]):
        qx = r00 * xs[i] + r01 * ys[i] + r02 * zs[i]
        qy = r10 * xs[i] + r11 * ys[i] + r12 * zs[i]
        qz = r20 * xs[i] + r21 * ys[i] + r22 * zs[i]
        z = qz + t2
        behind += 1 if z <= 0.0 else 0
        a = 1.0 / z
        x, y = (qx + t0) * a, (qy + t1) * a
        u, v, ux, uy, vx, vy = project(x, y, lens)
        eu, ev = u - us[i], v - vs[i]
        cost += eu * eu + ev * ev
        u3, u4 = ux * a, uy * a
        u5 = -(x * u3 + y * u4)
        v3, v4 = vx * a, vy * a
        v5 = -(x * v3 + y * v4)
        u0, u1, u2 = qy * u5 - qz * u4, qz * u3 - qx * u5, qx * u4 - qy * u3
        v0, v1, v2 = qy * v5 - qz * v4, qz * v3 - qx * v5, qx * v4 - qy * v3
        g0 += u0 * eu + v0 * ev
        g1 += u1 * eu + v1 * ev
        g2 += u2 * eu + v2 * ev
        g3 += u3 * eu + v3 * ev
        g4 += u4 * eu + v4 * ev
        g5 += u5 * eu + v5 * ev
        h00 += u0 * u0 + v0 * v0
        h01 += u0 * u1 + v0 * v1
        h02 += u0 * u2 + v0 * v2
        h03 += u0 * u3 + v0 * v3
        h04 += u0 * u4 + v0 * v4
        h05 += u0 * u5 + v0 * v5
        h11 += u1 * u1 + v1 * v1
        h12 += u1 * u2 + v1 * v2
        h13 += u1 * u3 + v1 * v3
        h14 += u1 * u4 + v1 * v4
        h15 += u1 * u5 + v1 * v5
        h22 += u2 * u2 + v2 * v2
        h23 += u2 * u3 + v2 * v3
        h24 += u2 * u4 + v2 * v4
        h25 += u2 * u5 + v2 * v5
        h33 += u3 * u3 + v3 * v3
        h34 += u3 * u4 + v3 * v4
        h35 += u3 * u5 + v3 * v5
        h44 += u4 * u4 + v4 * v4
        h45 += u4 * u5 + v4 * v5
        h55 += u5 * u5 + v5 * v5
    out[0], out[1], out[2], out[3], out[4], out[5] = g0, g1, g2, g3, g4, g5
    out[6], out[7], out[8], out[9], out[10], out[11] = h00, h01, h02, h03, h04, h05
    out[12], out[13], out[14], out[15], out[16] = h11, h12, h13, h14, h15
    out[17], out[18], out[19], out[20] = h22, h23, h24, h25
    out[21], out[22], out[23], out[24], out[25], out[26] = h33, h34, h35, h44, h45, h55
    return np.inf if behind else cost


@compiled
def _residuals(points: Array, pose: Array, lens: Array, bound_px2: float) -> tuple[float, int]:
    """The cost of a pose in px², and how many corners are off by more than `bound_px2`."""
    xs, ys, zs, us, vs = points[0], points[1], points[2], points[3], points[4]
    r00, r01, r02, r10, r11, r12 = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    r20, r21, r22, t0, t1, t2 = pose[6], pose[7], pose[8], pose[9], pose[10], pose[11]
    cost = 0.0
    off = 0
    for i in range(points.shape[1]):
        a = 1.0 / (r20 * xs[i] + r21 * ys[i] + r22 * zs[i] + t2)
        x = (r00 * xs[i] + r01 * ys[i] + r02 * zs[i] + t0) * a
        y = (r10 * xs[i] + r11 * ys[i] + r12 * zs[i] + t1) * a
        u, v, _, _, _, _ = project(x, y, lens)
        e = (u - us[i]) ** 2 + (v - vs[i]) ** 2
        cost += e
        off += 1 if e > bound_px2 else 0
    return cost, off


@compiled
def move(pose: Array, step: Array, moved: Array) -> None:
    """The pose after a step (w, d): turned by the quaternion (w / 2, 1), normalized."""
    x, y, z = 0.5 * step[0], 0.5 * step[1], 0.5 * step[2]
    s = 2.0 / (1.0 + x * x + y * y + z * z)
    d00, d11, d22 = 1.0 - s * (y * y + z * z), 1.0 - s * (x * x + z * z), 1.0 - s * (x * x + y * y)
    d01, d10 = s * (x * y - z), s * (x * y + z)
    d02, d20 = s * (x * z + y), s * (x * z - y)
    d12, d21 = s * (y * z - x), s * (y * z + x)
    for j in range(3):
        a, b, c = pose[j], pose[3 + j], pose[6 + j]
        moved[j] = d00 * a + d01 * b + d02 * c
        moved[3 + j] = d10 * a + d11 * b + d12 * c
        moved[6 + j] = d20 * a + d21 * b + d22 * c
        moved[9 + j] = pose[9 + j] + step[3 + j]


@compiled
def _solve(now: Array, matrix: Array, damping: float, L: Array, step: Array) -> bool:
    """Solves (matrix + damping diag H) step = -g by Cholesky; False where it is not definite.

    Args:
        now: (27,) of `normal_equations`.
        matrix: (27,) the matrix where `now` has H: H itself, or Newton's.
    """
    at = 6
    for i in range(6):
        L[i, i] = matrix[at] + damping * now[at]
        for j in range(i + 1, 6):
            L[j, i] = matrix[at + j - i]
        at += 6 - i
    for j in range(6):
        bound = 1e-14 * abs(L[j, j])
        total = L[j, j]
        for k in range(j):
            total -= L[j, k] * L[j, k]
        if not total > bound:
            return False
        # The diagonal keeps its inverse.
        L[j, j] = 1.0 / np.sqrt(total)
        for i in range(j + 1, 6):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * L[j, j]
    for i in range(6):
        total = -now[i]
        for k in range(i):
            total -= L[i, k] * step[k]
        step[i] = total * L[i, i]
    for i in range(5, -1, -1):
        total = step[i]
        for k in range(i + 1, 6):
            total -= L[k, i] * step[k]
        step[i] = total * L[i, i]
    return True


@compiled
def _second_derivatives(
    points: Array, pose: Array, lens: Array, now: Array, moved: Array, new: Array, out: Array
) -> None:
    """out[6:]: half the second derivatives of the cost, from differences of g.

    `moved` and `new` are scratch. g belongs to steps from the moved pose, which adds a part of g
    that is antisymmetric in the two directions: the mean of both takes it away.
    """
    full, step = np.empty((6, 6)), np.zeros(6)
    for i in range(6):
        h = _DIFFERENCE if i < 3 else _DIFFERENCE * pose[11]
        step[i] = h
        move(pose, step, moved)
        normal_equations(points, moved, lens, new)
        step[i] = 0.0
        for j in range(6):
            full[i, j] = (new[j] - now[j]) / h
    at = 6
    for i in range(6):
        for j in range(i, 6):
            out[at] = 0.5 * (full[i, j] + full[j, i])
            at += 1


@compiled
def _minimise(
    points: Array, lens: Array, pose: Array, moved: Array, work: Array, L: Array
) -> tuple[float, bool]:
    """Moves `pose` to a minimum: its cost in px², and whether it got there."""
    now, new, newton, step = work[0], work[1], work[2], work[3]
    cost = normal_equations(points, pose, lens, now)
    damping = 0.0
    known = False
    for count in range(MAX_STEPS):
        if not np.isfinite(cost):
            return cost, False
        matrix = now
        if count >= GAUSS_NEWTON_STEPS:
            if not known:
                _second_derivatives(points, pose, lens, now, moved, new, newton)
                known = True
            matrix = newton
        if _solve(now, matrix, damping, L, step):
            promised = 0.0
            for i in range(6):
                promised -= now[i] * step[i]
            move(pose, step, moved)
            if promised <= RELATIVE_TOLERANCE * cost + ABSOLUTE_TOLERANCE:
                if damping == 0.0:
                    pose[:] = moved
                    return cost - promised, True
                # A damped step may be short for its damping alone.
                damping = 0.0
                continue
            new_cost = normal_equations(points, moved, lens, new)
            if new_cost < cost:
                pose[:] = moved
                cost = new_cost
                now, new = new, now
                known = False
                damping = 0.1 * damping if damping > _FIRST_DAMPING else 0.0
                continue
        damping = max(10.0 * damping, _FIRST_DAMPING)
        if damping > _LAST_DAMPING:
            return cost, False
    return cost, False


@compiled
def _other_pose(pose: Array, normal: Array, other: Array) -> None:
    """The pose of a plane that looks alike from afar: mirrored across the line of sight.

    What turns the plane's vectors towards the camera changes its sign, what is across the line of
    sight stays; the plane's normal follows. A reflection on either side makes it a rotation.
    """
    distance2 = pose[9] ** 2 + pose[10] ** 2 + pose[11] ** 2
    for j in range(3):
        along = pose[9] * pose[j] + pose[10] * pose[3 + j] + pose[11] * pose[6 + j]
        for i in range(3):
            other[3 * i + j] = pose[3 * i + j] - 2.0 * along / distance2 * pose[9 + i]
    for i in range(3):
        across = (
            other[3 * i] * normal[0] + other[3 * i + 1] * normal[1] + other[3 * i + 2] * normal[2]
        )
        for j in range(3):
            other[3 * i + j] -= 2.0 * across * normal[j]
        other[9 + i] = pose[9 + i]


@compiled
def refine(
    corners: Array,
    subsets: npt.NDArray[np.int64],
    lens: Array,
    starts: Array,
    normals: Array,
    ambiguous: npt.NDArray[np.bool_],
    bound_px: float,
    poses: Array,
    costs: Array,
    good: npt.NDArray[np.bool_],
) -> None:
    """Writes the pose of least cost that is reached from each subset's starts.

    Args:
        corners: (N, 5, 4) x, y, z in metres and u, v in pixels of each marker's corners.
        subsets: (M, k) markers.
        starts, normals, ambiguous: from `starts`.
        bound_px: a corner may be off by this much.
        poses: (M, 12) the rotation by rows, then the camera's coordinates of the origin.
        costs: (M,) px².
        good: (M,) the minimum was reached, and no corner is off by more than the bound.
    """
    k = subsets.shape[1]
    points, centre = np.empty((5, 4 * k)), np.empty(3)
    work, L = np.empty((4, 27)), np.empty((6, 6))
    pose, moved, best = np.empty(12), np.empty(12), np.empty(12)
    for m in range(len(subsets)):
        for j in range(k):
            points[:, 4 * j : 4 * j + 4] = corners[subsets[m, j]]
        for axis in range(3):
            centre[axis] = points[axis].sum() / (4 * k)
            points[axis] -= centre[axis]
        least, reached = np.inf, False
        best[:] = np.nan
        for turn in range(3):
            if turn < 2:
                pose[:] = starts[m, turn]
            elif ambiguous[m] and np.isfinite(least):
                _other_pose(best, normals[m], pose)
            else:
                continue
            if not np.isfinite(pose[0]):
                continue
            cost, done = _minimise(points, lens, pose, moved, work, L)
            # The same minimum again, from a worse start, is not a better one.
            if cost < (least if not reached else least * (1.0 - _SAME_COST)):
                least, reached = cost, done
                best[:] = pose
        costs[m], off = _residuals(points, best, lens, bound_px * bound_px)
        good[m] = reached and off == 0
        for i in range(3):
            turned = 0.0
            for j in range(3):
                turned += best[3 * i + j] * centre[j]
            best[9 + i] -= turned
        poses[m] = best
