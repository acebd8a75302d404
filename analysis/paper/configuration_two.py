"""Configuration II: a drive around a rectangle, at most 1, 3, 5 and all markers on its sides."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.paper.site import Site
from analysis.tracking.consistency import nees
from analysis.tracking.drive import Drive, collect_drive, timeline, tracks_of
from analysis.tracking.statistics import ALL, drive_table
from pipeline.geometry import Array, Pose
from pipeline.localizer import FrameResult, Localizer, PipelineSettings
from pipeline.pose import RansacIterative
from pipeline.selection import MarkerLimit
from pipeline.tracker import ConstantVelocity
from recorder.files.truth_file import TruthPath
from recorder.simulation.trajectory import RectangleTrajectory

LIMITS: tuple[int | None, ...] = (1, 3, 5, None)
# The sides as the tracking study names them, in the order that they are driven.
TOP, LEFT, BOTTOM, RIGHT = SIDES = ("1 (max 1)", "2 (max 3)", "3 (max 5)", "4 (all)")
SIDE_NAMES = dict(zip(SIDES, ("top", "left", "bottom", "right"), strict=True))
# Half the width of the paper's grey band around its hand-measured path.
BAND_M = 0.05
PAPER_FILTERS = ("adaptive", "min", "max", "mean", "median")


@dataclass(frozen=True, eq=False)
class Outcome:
    """One drive of one seed as the tracking study sees it.

    Attributes:
        table: `analysis.tracking.statistics.drive_table`.
        nees: by tracker, (N,) of each frame.
        drive: what the table was made of; the first seed's only.
    """

    table: pd.DataFrame
    nees: Mapping[str, Array]
    drive: Drive | None

    def value(self, column: str, tracker: str, side: str = ALL) -> float:
        """One cell of the table."""
        rows = self.table[(self.table["tracker"] == tracker) & (self.table["side"] == side)]
        return float(rows[column].item())


def drive(site: Site, seed: int, speed_mps: float, trackers: dict[str, ConstantVelocity]) -> Drive:
    """Drives once around, with the detector's noise, and tracks with every filter."""
    trajectory = site.scene.file.trajectory
    if not isinstance(trajectory, RectangleTrajectory):
        raise ValueError(f"expected a rectangle to drive around, found {trajectory.kind}")
    trajectory = trajectory.model_copy(update={"speed_mps": speed_mps})
    lengths_m = (trajectory.width_m, trajectory.height_m) * 2
    ends_s = np.cumsum(lengths_m) / speed_mps
    limits = tuple(
        MarkerLimit(until_s=float(end), n=limit)
        for end, limit in zip(ends_s[:-1], LIMITS[:-1], strict=True)
    )
    times_s = np.arange(0.0, ends_s[-1] - 1e-9, 1.0 / site.scene.file.rate_hz).tolist()
    exact = [trajectory.pose(t) for t in times_s]
    settings = PipelineSettings(pose=RansacIterative(max_markers=limits), trackers=trackers)
    # The same noise at every speed would be the same luck.
    rng = np.random.default_rng([seed, 41, round(1000 * speed_mps)])
    corners_m = np.array([trajectory.pose(float(t)).translation[:2] for t in [0.0, *ends_s[:-1]]])
    return collect_drive(
        f"{speed_mps:g} m/s",
        _localized(site, seed, settings, times_s, exact, rng),
        exact,
        TruthPath(corners_m, closed=True, std_m=BAND_M),
        limits,
    )


def outcome(
    site: Site, seed: int, speed_mps: float, trackers: dict[str, ConstantVelocity]
) -> Outcome:
    """A drive and what the tracking study makes of it."""
    driven = drive(site, seed, speed_mps, trackers)
    exact_m = timeline(driven).exact_m
    if exact_m is None:
        raise ValueError("expected exact truth, found none")
    by_tracker = {t.name: nees(t.position_m - exact_m, t.variance_m2) for t in tracks_of(driven)}
    return Outcome(drive_table(driven), by_tracker, driven if seed == 0 else None)


def _localized(
    site: Site,
    seed: int,
    settings: PipelineSettings,
    times_s: list[float],
    exact: list[Pose],
    rng: np.random.Generator,
) -> Iterator[FrameResult]:
    localizer = Localizer(settings, site.camera, site.marker_map, start_ns=0)
    seen_from = site.true(seed)
    for i, (t, T_map_camera) in enumerate(zip(times_s, exact, strict=True)):
        yield localizer.advance(i, round(t * 1e9), seen_from(T_map_camera, rng))
