"""Configuration II: a drive around a rectangle, at most 1, 3, 5 and all markers on its sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.paper.site import Site
from pipeline.geometry import Array
from pipeline.pose import RansacIterative
from pipeline.selection import MarkerLimit
from pipeline.tracker import ConstantVelocity
from recorder.files.truth_file import TruthPath
from recorder.simulation.trajectory import RectangleTrajectory
from replay.accuracy import distance_to_path

SIDES = ("top", "left", "bottom", "right")
LIMITS: tuple[int | None, ...] = (1, 3, 5, None)
# Half the width of the paper's grey band around its hand-measured path.
BAND_M = 0.05
# A track jumps to its first fixes; that is not what its smoothness is about.
SETTLED_S = 2.0


@dataclass(frozen=True, eq=False)
class Drive:
    """One drive of one seed.

    Attributes:
        time_s, exact_m: (N,), (N, 2).
        side: (N,) index into `SIDES`.
        fixes_m: (N, 2); NaN without a pose.
        tracks_m: by tracker, (N, 2).
        nis: by tracker, (N,); NaN without an update.
        path: the measured path, here the exact one.
    """

    time_s: Array
    exact_m: Array
    side: Array
    fixes_m: Array
    tracks_m: dict[str, Array]
    nis: dict[str, Array]
    path: TruthPath


@dataclass(frozen=True)
class TrackFigures:
    """One tracker over a drive or one side of it."""

    rmse_m: float
    path_rms_m: float
    in_band: float
    acceleration_mps2: float
    mean_nis: float


def drive(site: Site, seed: int, speed_mps: float, trackers: dict[str, ConstantVelocity]) -> Drive:
    """Drives once around, with the detector's noise, and tracks with every filter."""
    trajectory = site.scene.file.trajectory
    if not isinstance(trajectory, RectangleTrajectory):
        raise ValueError(f"expected a rectangle to drive around, found {trajectory.kind}")
    trajectory = trajectory.model_copy(update={"speed_mps": speed_mps})
    lengths = np.array(
        [trajectory.width_m, trajectory.height_m, trajectory.width_m, trajectory.height_m]
    )
    ends_s = np.cumsum(lengths) / speed_mps
    time_s = np.arange(0.0, ends_s[-1] - 1e-9, 1.0 / site.scene.file.rate_hz)
    side = np.searchsorted(ends_s, time_s, side="right")
    spans = tuple(
        MarkerLimit(until_s=float(end), n=limit)
        for end, limit in zip(ends_s[:-1], LIMITS[:-1], strict=True)
    )
    solver = RansacIterative(max_markers=spans)
    corners = site.true(seed)
    # The same noise at every speed would be the same luck.
    rng = np.random.default_rng([seed, 41, round(1000 * speed_mps)])
    filters = {name: settings.build() for name, settings in trackers.items()}
    exact, fixes = np.empty((len(time_s), 2)), np.full((len(time_s), 2), np.nan)
    tracks = {name: np.empty((len(time_s), 2)) for name in trackers}
    nis = {name: np.empty(len(time_s)) for name in trackers}
    for i, t in enumerate(time_s.tolist()):
        T_map_camera = trajectory.pose(t)
        exact[i] = T_map_camera.translation[:2]
        fix = solver(corners(T_map_camera, rng), site.camera, site.marker_map, t)
        if fix.status == "ok" and fix.T_map_camera is not None:
            fixes[i] = fix.T_map_camera.translation[:2]
        for name, filter_ in filters.items():
            state = filter_.step(round(t * 1e9), fix)
            tracks[name][i] = state.x[[0, 2]]
            nis[name][i] = state.nis
    corners_m = np.array([trajectory.pose(float(t)).translation[:2] for t in [0.0, *ends_s[:-1]]])
    path = TruthPath(corners_m, closed=True, std_m=BAND_M)
    return Drive(time_s, exact, side.astype(np.float64), fixes, tracks, nis, path)


def figures(drive: Drive, tracker: str, side: int | None = None) -> TrackFigures:
    """What the comparison of the filters is made of, over the whole drive or one side."""
    chosen = np.ones(len(drive.time_s), bool) if side is None else drive.side == side
    track = drive.tracks_m[tracker]
    chosen &= np.isfinite(track).all(axis=1)
    error = track[chosen] - drive.exact_m[chosen]
    distance = distance_to_path(track[chosen], drive.path)
    dt = float(drive.time_s[1] - drive.time_s[0])
    settled = track[chosen & (drive.time_s >= SETTLED_S)]
    acceleration = np.diff(settled, n=2, axis=0) / dt**2
    nis = drive.nis[tracker][chosen]
    return TrackFigures(
        float(np.sqrt((error**2).sum(axis=1).mean())),
        float(np.sqrt((distance**2).mean())),
        float((distance <= drive.path.std_m).mean()),
        float(np.sqrt((acceleration**2).sum(axis=1).mean())),
        float(np.nanmean(nis)),
    )
