"""A drive's tables in memory, from a result or from a pipeline that ran just now."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.tracking.sides import Side, along, corner_to_corner
from pipeline.geometry import Array, Pose
from pipeline.localizer import FrameResult
from pipeline.selection import MaxMarkers
from recorder.files.truth_file import TruthPath, parse_truth
from replay.result import Result
from replay.tables import pose_columns

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Drive:
    """What the study reads of one replay.

    Attributes:
        tracks, poses, truth: tables of a result (`replay.tables`), frames in order; no truth: None.
        path: the hand-measured path, where there is one.
        max_markers: the limits on how many markers were used; they name the path's sides.
        from_s: seconds into the log of the first frame, where the limits' times count from.
    """

    name: str
    tracks: pd.DataFrame
    poses: pd.DataFrame
    truth: pd.DataFrame | None = None
    path: TruthPath | None = None
    max_markers: MaxMarkers = None
    from_s: float = 0.0


def load_drive(result: Result, name: str | None = None) -> Drive:
    """The drive of a result, called by the result's name unless another is given.

    Raises:
        InputError: a table or the truth of the result is not what it should be.
    """
    truth = None
    if (result.folder / "truth.parquet").exists():
        truth = result.table("truth")
    path = None
    truth_file = result.folder / "truth.yaml"
    if truth_file.exists():
        path = parse_truth(truth_file.read_bytes(), truth_file).path
    return Drive(
        name or result.name,
        result.table("tracks"),
        result.table("poses"),
        truth,
        path,
        result.settings.pose.max_markers,
        result.summary["from_s"] or 0.0,
    )


def collect_drive(
    name: str,
    results: Iterable[FrameResult],
    exact: Sequence[Pose] | None = None,
    path: TruthPath | None = None,
    max_markers: MaxMarkers = None,
) -> Drive:
    """The drive of a pipeline that ran in memory, with T_map_camera of each frame if known."""
    poses, tracks, truth = [], [], []
    for i, result in enumerate(results):
        frame = {"frame_index": result.frame_index, "timestamp_ns": result.timestamp_ns}
        x_m, y_m, *_ = pose_columns(result.fix.T_map_camera)
        fix = {"status": result.fix.status, "n_used": result.fix.n_used, "x_m": x_m, "y_m": y_m}
        poses.append({**frame, **fix})
        for tracker, state in result.tracks.items():
            x, vx, y, vy = state.x.tolist()
            row = {"tracker": tracker, "updated": state.updated, "x_m": x, "vx_mps": vx}
            row |= {"y_m": y, "vy_mps": vy, "nis": state.nis}
            row |= {"var_x_m2": float(state.P[0, 0]), "var_y_m2": float(state.P[2, 2])}
            for key, values in (
                ("innovation_{}_m", state.innovation_m),
                ("innovation_var_{}_m2", state.innovation_var_m2),
            ):
                row |= {key.format(axis): value for axis, value in zip("xy", values, strict=True)}
            tracks.append({**frame, **row})
        if exact is not None:
            x_m, y_m, *_ = exact[i].translation.tolist()
            truth.append({**frame, "kind": "exact", "x_m": x_m, "y_m": y_m})
    table = pd.DataFrame(truth) if exact is not None else None
    return Drive(name, pd.DataFrame(tracks), pd.DataFrame(poses), table, path, max_markers)


@dataclass(frozen=True, eq=False)
class Timeline:
    """What holds for all trackers, frame by frame; NaN where there is none.

    Attributes:
        frame_index, time_s: (N,); seconds from the first frame.
        n_used: (N,) markers that an `ok` fix used, else 0.
        fix_m: (N, 2) x, y of the `ok` fixes.
        exact_m: (N, 2) where the camera exactly was; None without exact truth.
        sides: of the path, in its order; none without a path.
        side: (N,) index into `sides`, or -1.
        sides_from: what the frames' sides were told by.
    """

    frame_index: IntArray
    time_s: Array
    n_used: IntArray
    fix_m: Array
    exact_m: Array | None
    sides: tuple[Side, ...]
    side: IntArray
    sides_from: str


@dataclass(frozen=True, eq=False)
class Track:
    """One tracker's rows, a frame each as in the timeline; (N, 2) are x and y."""

    name: str
    position_m: Array
    variance_m2: Array
    innovation_m: Array
    innovation_var_m2: Array
    nis: Array


def timeline(drive: Drive) -> Timeline:
    """The frames of a drive, each with its truth and its side of the path."""
    poses = drive.poses
    ok = (poses["status"] == "ok").to_numpy()
    fix_m = np.where(ok[:, None], poses[["x_m", "y_m"]].to_numpy(dtype=np.float64), np.nan)
    frame_index = poses["frame_index"].to_numpy(dtype=np.int64)
    stamps = poses["timestamp_ns"].to_numpy(dtype=np.int64)
    time_s = (stamps - stamps[0]) * 1e-9 if len(stamps) else np.empty(0)
    exact_m = _truth_m(drive.truth, "exact", frame_index)
    sides: tuple[Side, ...] = ()
    side, sides_from = np.full(len(poses), -1), ""
    if drive.path is not None:
        where, sides_from = _where(drive, exact_m, frame_index)
        found = corner_to_corner(drive.path)
        side = along(found, where)
        sides = tuple(
            s.named(drive.max_markers, drive.from_s + time_s[side == i])
            for i, s in enumerate(found)
        )
    n_used = np.where(ok, poses["n_used"].to_numpy(dtype=np.int64), 0)
    return Timeline(frame_index, time_s, n_used, fix_m, exact_m, sides, side, sides_from)


def tracks_of(drive: Drive) -> list[Track]:
    """The trackers in their order, with the frames of the drive's timeline."""
    frames = drive.poses["frame_index"]
    tracks = []
    for name, rows in drive.tracks.groupby("tracker", sort=False):
        table = rows.set_index("frame_index").reindex(frames)

        def pair(x: str, y: str, table: pd.DataFrame = table) -> Array:
            return table[[x, y]].to_numpy(dtype=np.float64)

        track = Track(
            str(name),
            pair("x_m", "y_m"),
            pair("var_x_m2", "var_y_m2"),
            pair("innovation_x_m", "innovation_y_m"),
            pair("innovation_var_x_m2", "innovation_var_y_m2"),
            table["nis"].to_numpy(dtype=np.float64),
        )
        tracks.append(track)
    return tracks


def _where(drive: Drive, exact_m: Array | None, frame_index: IntArray) -> tuple[Array, str]:
    """(N, 2) the best that is known of where the camera was, and what that is."""
    if exact_m is not None:
        return exact_m, "the exact truth"
    measured = _truth_m(drive.truth, "measured", frame_index)
    # Poses that were stood at say nothing of the way between them.
    if measured is not None and np.isfinite(measured).all(axis=1).mean() > 0.5:
        return measured, "the measured truth"
    stacked = np.stack([track.position_m for track in tracks_of(drive)])
    known = np.isfinite(stacked).all(axis=(0, 2))
    middle = np.full(stacked.shape[1:], np.nan)
    middle[known] = np.median(stacked[:, known], axis=0)
    return middle, "the trackers' median, for want of a timed truth"


def _truth_m(truth: pd.DataFrame | None, kind: str, frame_index: IntArray) -> Array | None:
    """(N, 2) x, y of the truth at frames; None where there is none of this kind."""
    if truth is None:
        return None
    rows = truth[(truth["kind"] == kind) & (truth["frame_index"] >= 0)]
    rows = rows.drop_duplicates("frame_index").set_index("frame_index")
    values = rows[["x_m", "y_m"]].reindex(frame_index).to_numpy(dtype=np.float64)
    return values if np.isfinite(values).any() else None
