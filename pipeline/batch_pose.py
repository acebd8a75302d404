"""Many subsets of one image's markers at once: the paper's solver, compiled, and as a plain loop.

For more than one marker `cv2.solvePnPRansac(flags=SOLVEPNP_ITERATIVE)` minimises the sum of squared
reprojection errors of those corners that its hypothesis explains within 8 px. The batch minimises
the same sum over all corners. What differs:

- OpenCV starts from EPnP on five of the corners and stops after a step shorter than 1e-3 (metres
  and radians together), a change of the cost by less than 1e-6, or 20 steps: where the geometry is
  weak, that is some tenths of a millimetre before the minimum. The batch starts from all corners'
  homography (from a DLT too where they are in no plane; also from the mirrored pose of a plane that
  looks small) and goes on to the minimum.
- OpenCV leaves out corners that a poor hypothesis put beyond 8 px, also where the final pose would
  explain them. The batch leaves out none. Where its minimum is off by more than 8 px at a corner,
  or was not reached, OpenCV's call itself gives the pose, outliers and all (`by_opencv`).
- One marker is no least-squares problem to OpenCV: its four corners go through P3P, which fits
  three of them exactly and lets the fourth choose. Its call gives that pose here too, for it is
  needed once a marker, unless `least_squares` is asked for.

A tilted sensor (the rational model's 13th and 14th coefficient) is left to OpenCV's call. An
equidistant lens is treated as in `pipeline.pose`: errors are those of the pixels that an ideal lens
would have given. OpenCV rounds its input to float32, the batch does not.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from pipeline.batch.opencv import solve_by_opencv
from pipeline.batch.poses import BatchPoses, BoolArray, Problem, Results
from pipeline.batch.subsets import Index, sample_subsets, subsets
from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array
from pipeline.markers import MarkerMap

__all__ = ["BatchPoses", "sample_subsets", "solve_subsets", "solve_subsets_opencv", "subsets"]

SingleMarker = Literal["p3p", "least_squares"]

# OpenCV's default `reprojectionError`.
OUTLIER_PX = 8.0
# Subsets at a time: what a thread takes, and what progress is counted in.
CHUNK = 8192
# Distances from a plane, as a share of its extent, that are rounding.
_FLAT = 1e-6


def solve_subsets(
    detections: Detections,
    camera: Camera,
    marker_map: MarkerMap,
    subsets: Index,
    *,
    single_marker: SingleMarker = "p3p",
    threads: int | None = None,
    progress: Callable[[int], object] | None = None,
) -> BatchPoses:
    """The camera's pose from each subset of one image's markers, compiled.

    The same input gives the same result, whatever the number of threads. The first call on a
    machine compiles (some ten seconds; kept on disk). Many images are one call each, which costs
    about half a millisecond before the first subset.

    Args:
        subsets: (M, k) positions in `detections`.
        single_marker: how subsets of one are solved: as the paper does, or like the others.
        threads: as many as this process has cores, unless it is said.
        progress: called with the number of further subsets done, from the calling thread.

    Raises:
        ValueError: no detections, one that the map lacks, or a position beyond them.
    """
    problem = Problem.of(detections, camera, marker_map)
    subsets = _checked(subsets, len(detections))
    out = Results.empty(len(subsets))
    paper = single_marker == "p3p" and subsets.shape[1] == 1
    compiled = None if paper or problem.lens is None else _Compiled.of(problem)

    def solve(first: int) -> int:
        rows = np.arange(first, min(first + CHUNK, len(subsets)))
        left = rows if compiled is None else rows[~compiled.solve(subsets, rows, out)]
        if len(left):
            solve_by_opencv(problem, subsets, left, out)
        return len(rows)

    tell = progress or (lambda count: None)
    chunks = range(0, len(subsets), CHUNK)
    threads = threads or cv2.getNumberOfCPUs()
    if threads == 1 or len(chunks) < 2:
        for first in chunks:
            tell(solve(first))
    else:
        with ThreadPoolExecutor(threads) as pool:
            try:
                for done in as_completed([pool.submit(solve, first) for first in chunks]):
                    tell(done.result())
            except BaseException:
                # Ctrl-C does not wait for what has not begun.
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return out.finished()


def solve_subsets_opencv(
    detections: Detections,
    camera: Camera,
    marker_map: MarkerMap,
    subsets: Index,
    *,
    progress: Callable[[int], object] | None = None,
) -> BatchPoses:
    """The same by a plain loop over OpenCV's call: what `solve_subsets` is held to.

    Arguments and errors are those of `solve_subsets`; every pose is `by_opencv`.
    """
    problem = Problem.of(detections, camera, marker_map)
    subsets = _checked(subsets, len(detections))
    out = Results.empty(len(subsets))
    for first in range(0, len(subsets), CHUNK):
        rows = np.arange(first, min(first + CHUNK, len(subsets)))
        solve_by_opencv(problem, subsets, rows, out)
        if progress is not None:
            progress(len(rows))
    return out.finished()


def _checked(subsets: Index, n: int) -> Index:
    subsets = np.ascontiguousarray(subsets, dtype=np.int64)
    if subsets.ndim != 2 or subsets.shape[1] < 1:
        raise ValueError(f"expected subsets of shape (M, k), found {subsets.shape}")
    if len(subsets) and not (subsets.min() >= 0 and subsets.max() < n):
        raise ValueError(
            f"expected positions from 0 to {n - 1}, found {subsets.min()} to {subsets.max()}"
        )
    return subsets


@dataclass(frozen=True, eq=False)
class _Compiled:
    """One image as the compiled solver wants it.

    Its points are in the axes of their best plane about their centroid, X = basis (X_map - origin),
    so that a flat map needs no search for the plane of each subset.

    Attributes:
        flat: every marker lies in the plane z = 0.
        sums: of each marker, from `marker_sums`.
        corners: (N, 5, 4) x, y, z and u, v.
    """

    origin: Array
    basis: Array
    flat: bool
    sums: Array
    corners: Array
    lens: Array

    @classmethod
    def of(cls, problem: Problem) -> _Compiled:
        from pipeline.batch.start import marker_sums

        points = problem.object_points.reshape(-1, 3)
        origin = points.mean(axis=0)
        _, _, basis = np.linalg.svd(points - origin, full_matrices=False)
        basis[2] *= np.linalg.det(basis)
        local = (points - origin) @ basis.T
        flat = bool(np.abs(local[:, 2]).max() <= _FLAT * np.abs(local).max())
        local = local.reshape(-1, 4, 3)
        corners = np.concatenate([local, problem.pixels], axis=2).transpose(0, 2, 1)
        sums = marker_sums(local, problem.rays)
        assert problem.lens is not None
        return cls(origin, basis, flat, sums, np.ascontiguousarray(corners), problem.lens)

    def solve(self, subsets: Index, rows: Index, out: Results) -> BoolArray:
        """Writes the results' `rows`; (m,) which of them may stand."""
        from pipeline.batch.refine import refine
        from pipeline.batch.start import starts

        chosen, m = subsets[rows], len(rows)
        first, normals, ambiguous = np.empty((m, 2, 12)), np.empty((m, 3)), np.empty(m, np.bool_)
        poses, costs, good = np.empty((m, 12)), np.empty(m), np.empty(m, np.bool_)
        starts(self.sums, chosen, self.flat, first, normals, ambiguous)
        refine(
            self.corners, chosen, self.lens, first, normals, ambiguous, OUTLIER_PX,
            poses, costs, good,
        )  # fmt: skip
        # P = R (basis (X_map - origin)) + t
        R_camera_map = poses[:, :9].reshape(-1, 3, 3) @ self.basis
        t = poses[:, 9:] - R_camera_map @ self.origin
        out.write(rows, R_camera_map, t, np.sqrt(costs / (4 * chosen.shape[1])))
        out.converged[rows] = good
        return good
