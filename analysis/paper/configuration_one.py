"""Configuration I: two rings of markers under a camera that stands still."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from analysis.paper.references import CLASSES
from analysis.paper.site import Site
from pipeline.batch_pose import (
    BatchPoses,
    sample_subsets,
    solve_subsets,
    solve_subsets_opencv,
    subsets,
)
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose, wrap_angle

Solver = Literal["opencv", "batch"]

MAX_COUNT = 7
# The paper's solver takes a tenth of a millisecond: of six and seven markers only so many subsets.
OPENCV_SAMPLE = 10_000
OPENCV_WHOLE = 5
# What the paper calls a large error.
LARGE_M = 0.20


@dataclass(frozen=True, eq=False)
class CountErrors:
    """Errors over the subsets of one number of markers; x, y in m, yaw in rad.

    Attributes:
        subsets, of: how many were solved, and how many there are.
        rmse, mean: (3,).
        variance_m2: (2,) of x and y about their mean: needs no truth.
        max_m: largest horizontal position error.
    """

    subsets: int
    of: int
    rmse: Array
    mean: Array
    variance_m2: Array
    max_m: float


@dataclass(frozen=True, eq=False)
class Stand:
    """One seed at one height, by the paper's solver unless it says otherwise.

    Attributes:
        single: by id, the error (x m, y m, yaw rad) of the marker alone.
        pairs: by two ids, likewise.
        counts: by number of markers.
        batch: likewise by the batch solver, every subset.
    """

    single: dict[int, Array]
    pairs: dict[tuple[int, int], Array]
    counts: dict[int, CountErrors]
    batch: dict[int, CountErrors]


def stand_alone(site: Site, seed: int) -> Stand:
    """One image of the true site of a seed: single markers and pairs only."""
    seen, T_map_camera = _image(site, seed)
    errors = {n: _solved(site, seen, T_map_camera, n, "opencv") for n in (1, 2)}
    return Stand(_single(seen, errors[1]), _pairs(seen, errors[2]), {}, {})


def stand_by_opencv(site: Site, seed: int) -> Stand:
    """The same, and the paper's solver for each number of markers."""
    seen, T_map_camera = _image(site, seed)
    errors = {
        n: _solved(site, seen, T_map_camera, n, "opencv", seed) for n in range(1, MAX_COUNT + 1)
    }
    counts = {n: _statistics(e) for n, e in errors.items()}
    return Stand(_single(seen, errors[1]), _pairs(seen, errors[2]), counts, {})


def by_batch(site: Site, seed: int, tick: Callable[[], None]) -> dict[int, CountErrors]:
    """Every subset of one to seven markers of the same image; `tick` after each number."""
    seen, T_map_camera = _image(site, seed)
    counts = {}
    for n in range(1, MAX_COUNT + 1):
        counts[n] = _statistics(_solved(site, seen, T_map_camera, n, "batch"))
        tick()
    return counts


@dataclass(frozen=True, eq=False)
class _Solved:
    """(M, k) positions, (M, 3) errors with NaN where there is no pose, and how many there are."""

    subsets: npt.NDArray[np.int64]
    errors: Array
    of: int


def _image(site: Site, seed: int) -> tuple[Detections, Pose]:
    T_map_camera = site.scene.pose(0.0)
    # The same noise at both heights would be the same luck.
    rng = np.random.default_rng([seed, 31, round(1000 * float(T_map_camera.translation[2]))])
    return site.true(seed)(T_map_camera, rng), T_map_camera


def _solved(
    site: Site, seen: Detections, T_map_camera: Pose, count: int, solver: Solver, seed: int = 0
) -> _Solved:
    chosen = subsets(len(seen), count)
    of = len(chosen)
    if solver == "batch":
        poses = solve_subsets(seen, site.camera, site.marker_map, chosen)
    else:
        if count > OPENCV_WHOLE:
            chosen = sample_subsets(len(seen), count, OPENCV_SAMPLE, seed)
        poses = solve_subsets_opencv(seen, site.camera, site.marker_map, chosen)
    return _Solved(chosen, _errors(poses, T_map_camera), of)


def _errors(poses: BatchPoses, T_map_camera: Pose) -> Array:
    """(M, 3) x m, y m, yaw rad."""
    difference = poses.positions_m[:, :2] - T_map_camera.translation[:2]
    return np.column_stack([difference, wrap_angle(poses.yaw_rad - T_map_camera.yaw_rad)])


def _single(seen: Detections, solved: _Solved) -> dict[int, Array]:
    return {
        int(seen.ids[i]): error
        for (i,), error in zip(solved.subsets.tolist(), solved.errors, strict=True)
        if np.isfinite(error).all()
    }


def _pairs(seen: Detections, solved: _Solved) -> dict[tuple[int, int], Array]:
    return {
        (int(seen.ids[i]), int(seen.ids[j])): error
        for (i, j), error in zip(solved.subsets.tolist(), solved.errors, strict=True)
        if np.isfinite(error).all()
    }


def _statistics(solved: _Solved) -> CountErrors:
    errors = solved.errors[np.isfinite(solved.errors).all(axis=1)]
    return CountErrors(
        len(solved.subsets),
        solved.of,
        np.sqrt((errors**2).mean(axis=0)),
        errors.mean(axis=0),
        errors[:, :2].var(axis=0),
        float(np.hypot(errors[:, 0], errors[:, 1]).max()),
    )


def separation_m(site: Site, pair: tuple[int, int]) -> float:
    """Distance between two markers' centres."""
    a, b = (site.marker_map.by_id[i].centre_m for i in pair)
    return float(np.linalg.norm(a - b))


def off_centre_m(site: Site, pair: tuple[int, int]) -> float:
    """Mean distance of two markers from the point below (or above) the camera."""
    foot = site.scene.pose(0.0).translation[:2]
    distances = [np.linalg.norm(site.marker_map.by_id[i].centre_m[:2] - foot) for i in pair]
    return float(np.mean(distances))


def with_tags(site: Site, stand: Stand, *tags: str) -> Array:
    """(N, 3) errors of the single markers that the map gives all of these tags."""
    wanted = set(tags)
    rows = [e for i, e in stand.single.items() if wanted <= set(site.marker_map.by_id[i].tags)]
    return np.array(rows).reshape(-1, 3)


def of_class(site: Site, stand: Stand, name: str) -> Array:
    """(N, 3) errors of the single markers of one of the paper's classes."""
    return with_tags(site, stand, *CLASSES[name])


def horizontal_m(errors: Array) -> Array:
    """(N,) size of each position error."""
    return np.hypot(errors[:, 0], errors[:, 1])


def rmse_m(errors: Array) -> float:
    """Of the horizontal position."""
    return float(np.sqrt((errors[:, :2] ** 2).sum(axis=1).mean()))


def large_share(errors: Array) -> float:
    """The share of position errors above the paper's 20 cm."""
    return float((horizontal_m(errors) > LARGE_M).mean())


def size(errors: Array) -> float:
    """Of the position part of (x, y, …)."""
    return float(np.hypot(errors[0], errors[1]))


def solved_whole(counts: Mapping[int, CountErrors]) -> int:
    """Up to which number of markers every subset was solved: only there is a maximum one."""
    return max(n for n, c in counts.items() if c.subsets == c.of)
