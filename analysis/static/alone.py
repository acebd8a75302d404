"""Fixes from one marker alone and from two, by the pipeline's own solver, frame by frame."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from analysis.static.groups import Grouping, group
from analysis.static.view import StillFrame, StillView
from pipeline.geometry import Array, wrap_angle

# Axis, its column in the fixes, the unit people read and its size in SI.
AXES = (("x", 0, "cm", 100.0), ("y", 1, "cm", 100.0), ("yaw", 2, "deg", 180.0 / np.pi))


@dataclass(frozen=True, eq=False)
class Fixes:
    """Fixes of each subset of markers in each frame.

    All finite poses are in, also those that the pipeline's checks would reject: what a solver
    makes of few markers is what is studied.

    Attributes:
        subsets: the markers of each column, ids ascending.
        values: (frames, subsets, 3) x m, y m, yaw rad; NaN without a pose.
        errors: likewise, against the truth; NaN without one.
        rejected: (frames, subsets) the pipeline would have rejected the pose.
    """

    subsets: tuple[tuple[int, ...], ...]
    values: Array
    errors: Array
    rejected: npt.NDArray[np.bool_]

    @property
    def horizontal_m(self) -> Array:
        """(frames, subsets) size of the horizontal position error."""
        return np.hypot(self.errors[..., 0], self.errors[..., 1])

    def deviations(self) -> Array:
        """Like `errors`, but about the mean fix: what the spread is taken of without a truth."""
        deviations = self.values.copy()
        known = np.isfinite(deviations).all(axis=2)
        if not known.any():
            return deviations
        deviations[..., :2] -= deviations[known][:, :2].mean(axis=0)
        yaw = deviations[known][:, 2]
        middle = np.arctan2(np.sin(yaw).mean(), np.cos(yaw).mean())
        deviations[..., 2] = wrap_angle(deviations[..., 2] - middle)
        return deviations

    def columns(self, ids: Sequence[int]) -> npt.NDArray[np.int64]:
        """The positions of the subsets that hold only markers of `ids`."""
        wanted = set(ids)
        return np.array([i for i, s in enumerate(self.subsets) if wanted.issuperset(s)], np.int64)


def solve_each(
    view: StillView,
    size: int,
    frames: Sequence[StillFrame] | None = None,
    *,
    step: Callable[[], object] = lambda: None,
) -> Fixes:
    """Every subset of `size` of the markers seen, in every frame (or `frames`) that has it.

    Args:
        step: called after each frame.
    """
    frames = view.frames if frames is None else frames
    subsets = tuple(combinations(view.ids, size))
    values = np.full((len(frames), len(subsets), 3), np.nan)
    rejected = np.zeros(values.shape[:2], dtype=bool)
    solver = view.solver
    for f, frame in enumerate(frames):
        place = {int(i): n for n, i in enumerate(frame.detections.ids)}
        for number, subset in enumerate(subsets):
            if not place.keys() >= set(subset):
                continue
            chosen = frame.detections.select([place[i] for i in subset])
            fix = solver(chosen, view.camera, view.marker_map, frame.time_s)
            pose = fix.T_map_camera
            if pose is not None and pose.is_finite():
                values[f, number] = (*pose.translation[:2], pose.yaw_rad)
                rejected[f, number] = fix.status != "ok"
        step()
    errors = values - np.array([frame.truth for frame in frames])[:, None, :]
    errors[..., 2] = wrap_angle(errors[..., 2])
    return Fixes(subsets, values, errors, rejected)


@dataclass(frozen=True, eq=False)
class Alone:
    """One view with every marker solved alone.

    Attributes:
        height_m: that of the view; NaN where nothing gives it.
        suffix: tells results at the same height apart, by their folder; else empty.
        errors: (frames, markers, 3) cm, cm, degrees; about the mean fix without a truth.
    """

    view: StillView
    height_m: float
    suffix: str
    grouping: Grouping
    fixes: Fixes
    errors: Array

    @property
    def height(self) -> str:
        """As tables show it, whose column has the unit."""
        return f"{self.height_m:.3f}{self.suffix}"

    @property
    def label(self) -> str:
        return f"{self.height_m:.3f} m{self.suffix}"

    @property
    def has_truth(self) -> bool:
        return self.view.truth_kind is not None

    def of(self, ids: Sequence[int]) -> Array:
        """(frames, markers, 3) errors of some markers."""
        return self.errors[:, self.fixes.columns(ids)]


def solve_alone(views: Sequence[StillView], *, progress: bool = False) -> list[Alone]:
    """Every marker of every view alone; views by height, nearest first."""
    views = sorted(views, key=lambda view: view.height_m)
    shared = len({f"{view.height_m:.3f}" for view in views}) < len(views)
    found = []
    with tqdm(
        total=sum(len(view.frames) for view in views),
        unit="frame",
        desc="solve",
        file=sys.stderr,
        disable=None if progress else True,
    ) as bar:
        for view in views:
            fixes = solve_each(view, 1, step=bar.update)
            values = fixes.deviations() if view.truth_kind is None else fixes.errors
            errors = values * np.array([scale for *_, scale in AXES])
            grouping = group(view.marker_map, view.ids, view.centre_distance_px)
            suffix = f" ({view.result.folder})" if shared else ""
            found.append(Alone(view, view.height_m, suffix, grouping, fixes, errors))
    return found
