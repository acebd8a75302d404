"""Least squares of the reprojection error by Levenberg-Marquardt, one subset at a time.

The cost is OpenCV's: the sum over corners of |project(R (X - c) + t) - u|² in distorted pixels, c
the centroid of the subset. A step (w, d) turns R into exp(w) R, to second order, and adds d to t;
the Jacobian of a camera-frame point P = R (X - c) + t is [ -[P - t]x | I ]. Normal equations
H = J^T J and g = J^T r are summed corner by corner in a loop that the compiler vectorizes.

Sources: Moré 1978 (damping scaled by the diagonal); OpenCV's camera model (`projectPoints`);
Schweighofer & Pinz, PAMI 2006 (the two poses of a plane).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array

Function = TypeVar("Function", bound=Callable[..., Any])

MAX_STEPS = 60
# A step that promises less than this share of the cost, or this many px², is the last one.
RELATIVE_TOLERANCE = 1e-9
ABSOLUTE_TOLERANCE = 1e-13
_FIRST_DAMPING = 1e-3
_LAST_DAMPING = 1e9
# A minimum is only one where the step is (nearly) undamped.
_UNDAMPED = 1e-4

# What a reordered sum may do, and nothing that assumes finite numbers.
_FAST = {"reassoc", "contract", "nsz", "arcp"}


def compiled(function: Function) -> Function:
    """Machine code that runs without the interpreter lock.

    A compiled function calls only those of its own file: the cache notices no other file's change.
    """
    return cast(Function, numba.njit(cache=True, nogil=True, fastmath=_FAST)(function))


@compiled
def normal_equations(points: Array, n: int, pose: Array, lens: Array, out: Array) -> float:
    """The cost of a pose in px²; infinite when a corner is behind the camera.

    Args:
        points: (5, >= n) x, y, z from the centroid in metres; u, v in pixels.
        pose: (12,) rotation by rows, translation.
        lens: (16,) fx, fy, cx, cy and OpenCV's k1, k2, p1, p2, k3 … k6, s1 … s4.
        out: (27,) g, then the upper triangle of H by rows.
    """
    xs, ys, zs, us, vs = points[0], points[1], points[2], points[3], points[4]
    r00, r01, r02, r10, r11, r12 = pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]
    r20, r21, r22, t0, t1, t2 = pose[6], pose[7], pose[8], pose[9], pose[10], pose[11]
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    k1, k2, p1, p2, k3, k4, k5, k6 = (
        lens[4], lens[5], lens[6], lens[7], lens[8], lens[9], lens[10], lens[11],
    )  # fmt: skip
    s1, s2, s3, s4 = lens[12], lens[13], lens[14], lens[15]
    cost = 0.0
    behind = 0
    g0 = g1 = g2 = g3 = g4 = g5 = 0.0
    h00 = h01 = h02 = h03 = h04 = h05 = h11 = h12 = h13 = h14 = h15 = 0.0
    h22 = h23 = h24 = h25 = h33 = h34 = h35 = h44 = h45 = h55 = 0.0
    for i in range(n):
        qx = r00 * xs[i] + r01 * ys[i] + r02 * zs[i]
        qy = r10 * xs[i] + r11 * ys[i] + r12 * zs[i]
        qz = r20 * xs[i] + r21 * ys[i] + r22 * zs[i]
        z = qz + t2
        behind += 1 if z <= 0.0 else 0
        a = 1.0 / z
        x, y = (qx + t0) * a, (qy + t1) * a
        r2 = x * x + y * y
        # radial = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶), slope = its d / d(r²)
        below = 1.0 / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) * below
        slope = (
            k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3) - radial * (k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6))
        ) * below
        xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2)
        yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4)
        prism_x, prism_y = 2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2)
        cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        dxx = fx * (radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x)
        dxy = fx * (cross + prism_x * y)
        dyx = fy * (cross + prism_y * x)
        dyy = fy * (radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y)
        eu = fx * xd + cx - us[i]
        ev = fy * yd + cy - vs[i]
        cost += eu * eu + ev * ev
        u3, u4 = dxx * a, dxy * a
        u5 = -(x * u3 + y * u4)
        v3, v4 = dyx * a, dyy * a
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
def _solve(out: Array, damping: float, L: Array, step: Array) -> bool:
    """The step of (H + damping diag H) step = -g by Cholesky; False where H is singular."""
    at = 6
    for i in range(6):
        for j in range(i, 6):
            L[j, i] = out[at]
            at += 1
        L[i, i] *= 1.0 + damping
    for j in range(6):
        bound = 1e-14 * L[j, j]
        total = L[j, j]
        for k in range(j):
            total -= L[j, k] * L[j, k]
        if not total > bound:
            return False
        inverse = 1.0 / np.sqrt(total)
        L[j, j] = inverse
        for i in range(j + 1, 6):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * inverse
    for i in range(6):
        total = -out[i]
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
def _move(pose: Array, step: Array, moved: Array) -> None:
    """The pose after a step: rotation by the quaternion (1, w / 2), normalized."""
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
def _minimise(
    points: Array, n: int, lens: Array, pose: Array, moved: Array, work: Array, L: Array
) -> tuple[float, bool, int]:
    """Moves `pose` into a minimum: its cost in px², whether it is one, and the steps taken."""
    now, new, step = work[0], work[1], work[2]
    cost = normal_equations(points, n, pose, lens, now)
    damping = 0.0
    for count in range(MAX_STEPS):
        if not np.isfinite(cost):
            return cost, False, count
        if _solve(now, damping, L, step):
            promised = 0.0
            for i in range(6):
                promised -= now[i] * step[i]
            last = promised <= RELATIVE_TOLERANCE * cost + ABSOLUTE_TOLERANCE
            _move(pose, step, moved)
            if last and damping <= _UNDAMPED:
                pose[:12] = moved[:12]
                return max(cost - promised, 0.0), True, count + 1
            new_cost = normal_equations(points, n, moved, lens, new)
            if new_cost < cost:
                pose[:12] = moved[:12]
                cost = new_cost
                now, new = new, now
                damping = damping * 0.1 if damping > 1e-8 else 0.0
                continue
        damping = max(10.0 * damping, _FIRST_DAMPING)
        if damping > _LAST_DAMPING:
            return cost, False, count
    return cost, False, MAX_STEPS


@compiled
def refine(
    corners: Array,
    subsets: npt.NDArray[np.int64],
    lens: Array,
    starts: Array,
    normals: Array,
    twice: bool,
    poses: Array,
    costs: Array,
    worst: Array,
    converged: npt.NDArray[np.bool_],
    stats: npt.NDArray[np.int64],
) -> None:
    n = 4 * subsets.shape[1]
    points = np.empty((5, n))
    work, L = np.empty((3, 27)), np.empty((6, 6))
    pose, moved = np.empty(12), np.empty(12)
    for m in range(len(subsets)):
        c0 = c1 = c2 = 0.0
        at = 0
        for marker in subsets[m]:
            for i in range(4):
                for axis in range(5):
                    points[axis, at] = corners[marker, axis, i]
                at += 1
        for i in range(n):
            c0 += points[0, i]
            c1 += points[1, i]
            c2 += points[2, i]
        c0, c1, c2 = c0 / n, c1 / n, c2 / n
        for i in range(n):
            points[0, i] -= c0
            points[1, i] -= c1
            points[2, i] -= c2
        best = np.inf
        converged[m] = False
        for turn in range(3):
            if turn < 2:
                for i in range(12):
                    pose[i] = starts[m, turn, i]
                if not np.isfinite(pose[0]):
                    continue
            else:
                if not np.isfinite(best) or not twice:
                    continue
                # flip
                b = poses[m]
                lv = np.sqrt(b[9] * b[9] + b[10] * b[10] + b[11] * b[11])
                e0, e1, e2 = normals[m, 0], normals[m, 1], normals[m, 2]
                for j in range(3):
                    s = (b[9] * b[j] + b[10] * b[3 + j] + b[11] * b[6 + j]) * 2.0 / (lv * lv)
                    for i in range(3):
                        pose[3 * i + j] = b[3 * i + j] - s * b[9 + i]
                for i in range(3):
                    s = pose[3 * i] * e0 + pose[3 * i + 1] * e1 + pose[3 * i + 2] * e2
                    pose[3 * i] -= 2.0 * s * e0
                    pose[3 * i + 1] -= 2.0 * s * e1
                    pose[3 * i + 2] -= 2.0 * s * e2
                    pose[9 + i] = b[9 + i]
            cost, ok, steps = _minimise(points, n, lens, pose, moved, work, L)
            stats[turn] += steps
            if cost < best:
                if turn == 2 and cost < best * 0.999:
                    stats[3] += 1
                best = cost
                converged[m] = ok
                for i in range(12):
                    poses[m, i] = pose[i]
        costs[m] = best
        w = poses[m]
        # back to the origin
        for i in range(3):
            w[9 + i] -= w[3 * i] * c0 + w[3 * i + 1] * c1 + w[3 * i + 2] * c2
