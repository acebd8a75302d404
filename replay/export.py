"""A result's trajectories in the formats of other tools."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from pipeline.geometry import Array, Pose, unit_quaternion
from recorder.errors import InputError
from recorder.files.output_file import write_whole
from recorder.log import topics
from recorder.log.trajectory_writer import TimedPose, write_trajectories
from replay.accuracy import FIXES
from replay.result import Result

if TYPE_CHECKING:
    import pandas as pd

Format = Literal["tum", "kitti", "csv", "mcap"]

TRUTH = "truth"

FILE_SUFFIX: dict[Format, str] = {
    "tum": ".tum",
    "kitti": ".kitti.txt",
    "csv": ".csv",
    "mcap": ".mcap",
}
# What a file of each may end in: plain columns of numbers are often .txt.
SUFFIXES: dict[Format, tuple[str, ...]] = {
    "tum": (".tum", ".txt"),
    "kitti": (".kitti", ".txt"),
    "csv": (".csv",),
    "mcap": (".mcap",),
}
FIX_TOPIC = "/fix"
TRACK_TOPIC = "/track"

_POSE = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
_FURTHER = {
    FIXES: ["yaw_rad", "n_used", "reprojection_rms_px"],
    TRUTH: ["yaw_rad", "std_m"],
}
_FURTHER_TRACK = ["vx_mps", "vy_mps", "var_x_m2", "var_y_m2", "updated"]


@dataclass(frozen=True, eq=False)
class Exported:
    """A trajectory to be written.

    Attributes:
        table: `frame_index`, `timestamp_ns`, pose columns and further ones; whole poses only.
        left_out: frames of the replay without a whole pose.
    """

    name: str
    table: pd.DataFrame
    left_out: int


def trajectory(result: Result, name: str) -> Exported:
    """The trajectory of a tracker, of the `fixes` or of the `truth`, T_map_camera frame by frame.

    Trackers estimate x and y only: z and orientation are the fix's where the frame has an `ok` one,
    else those of the last. The truth is the exact one where there is one, else the measured.

    Raises:
        InputError: the result has no such trajectory, or no whole pose in it.
    """
    poses = result.table("poses")
    fixes = poses[poses["status"] == "ok"]
    if name == FIXES:
        table, further = fixes, _FURTHER[FIXES]
    elif name == TRUTH:
        table, further = _truth(result), _FURTHER[TRUTH]
    else:
        names = list(result.settings.trackers)
        if name not in names:
            known = ", ".join([*names, FIXES, TRUTH])
            raise InputError(result.folder, f"expected one of {known}, found {name!r}", "--tracker")
        tracks = result.table("tracks")
        table, further = _with_attitude(tracks[tracks["tracker"] == name], poses), _FURTHER_TRACK
    whole = table[["frame_index", "timestamp_ns", *_POSE, *further]]
    whole = whole[np.isfinite(whole[_POSE].to_numpy(dtype=np.float64)).all(axis=1)]
    if not len(whole):
        raise InputError(
            result.folder, f"expected whole poses (x, y, z and orientation) of {name}, found none"
        )
    return Exported(name, whole.reset_index(drop=True), len(poses) - len(whole))


def export(result: Result, format: Format, name: str | None, path: Path) -> list[Exported]:
    """Writes one trajectory to `path`; in an mcap all of them, unless one is named.

    Without a name it is the first tracker's, in an mcap also the one that the frame `camera`
    follows.

    Returns:
        What was written.

    Raises:
        InputError: the result has no such trajectory.
    """
    first = next(iter(result.settings.trackers))
    if format != "mcap":
        exported = trajectory(result, name or first)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, TEXT[format](exported.table).encode())
        return [exported]
    names = [name] if name else [FIXES, *result.settings.trackers, *_truth_if_any(result)]
    trajectories = [trajectory(result, each) for each in names]
    kind = _truth_kind(result)
    by_topic = {_topic(e.name, kind): list(_timed(e.table)) for e in trajectories}
    write_trajectories(
        path,
        by_topic,
        camera_topic=_topic(name or first, kind),
        attachments={
            file: (result.folder / file).read_bytes()
            for file in (topics.CAMERA_FILE, topics.MAP_FILE, *topics.TRUTH_FILES)
            if (result.folder / file).exists()
        },
        metadata={"result": result.name, "log_sha256": str(result.summary["log_sha256"])},
    )
    return trajectories


def tum(table: pd.DataFrame) -> str:
    """`t x y z qx qy qz qw` a line: seconds since 1970, exact to the nanosecond."""
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for timestamp_ns, pose in zip(table["timestamp_ns"].tolist(), _poses(table), strict=True):
        seconds, nanoseconds = divmod(timestamp_ns, 10**9)
        numbers = " ".join(map(repr, pose.tolist()))
        lines.append(f"{seconds}.{nanoseconds:09d} {numbers}")
    return "\n".join(lines) + "\n"


def kitti(table: pd.DataFrame) -> str:
    """The first three rows of T_map_camera in a line; no times."""
    lines = []
    for row in _poses(table):
        pose = Pose.from_quat(row[:3], row[3:])
        matrix = np.column_stack([pose.rotation, pose.translation])
        lines.append(" ".join(map(repr, matrix.ravel().tolist())))
    return "\n".join(lines) + "\n"


def comma_separated(table: pd.DataFrame) -> str:
    """All columns, as `replay --truth` reads them too."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows(zip(*(table[column].tolist() for column in table), strict=True))
    return text.getvalue()


TEXT: dict[str, Callable[[pd.DataFrame], str]] = {
    "tum": tum,
    "kitti": kitti,
    "csv": comma_separated,
}


def _with_attitude(track: pd.DataFrame, poses: pd.DataFrame) -> pd.DataFrame:
    """The track with z and orientation of the last `ok` fix up to each frame."""
    attitude = poses[["frame_index", *_POSE[2:]]].copy()
    attitude.loc[poses["status"] != "ok", _POSE[2:]] = np.nan
    attitude[_POSE[2:]] = attitude[_POSE[2:]].ffill()
    return track.merge(attitude, on="frame_index", how="left")


def _truth_kind(result: Result) -> str | None:
    """`exact`, `measured`, or None without timed truth."""
    if not (result.folder / "truth.parquet").exists():
        return None
    kinds = set(result.table(TRUTH)["kind"])
    return next((kind for kind in ("exact", "measured") if kind in kinds), None)


def _truth(result: Result) -> pd.DataFrame:
    kind = _truth_kind(result)
    if kind is None:
        raise InputError(result.folder, "expected a timed truth, found none", "--tracker truth")
    table = result.table(TRUTH)
    rows = table[(table["kind"] == kind) & (table["frame_index"] >= 0)]
    whole = np.isfinite(rows[_POSE].to_numpy(dtype=np.float64)).all(axis=1)
    # A pose that was stood at may lie beside one of a trajectory: the whole one counts.
    distinct: pd.DataFrame = rows[whole].drop_duplicates("frame_index")
    return distinct


def _truth_if_any(result: Result) -> list[str]:
    return [TRUTH] if _truth_kind(result) is not None and len(_truth(result)) else []


def _topic(name: str, truth_kind: str | None) -> str:
    if name == FIXES:
        return FIX_TOPIC
    if name == TRUTH:
        return topics.TRUTH_EXACT if truth_kind == "exact" else topics.TRUTH_POSE
    return f"{TRACK_TOPIC}/{name}"


def _poses(table: pd.DataFrame) -> Array:
    """(N, 7) position and unit quaternion."""
    poses = table[_POSE].to_numpy(dtype=np.float64)
    return np.array([[*row[:3], *unit_quaternion(row[3:])] for row in poses])


def _timed(table: pd.DataFrame) -> list[TimedPose]:
    stamps = zip(table["frame_index"].tolist(), table["timestamp_ns"].tolist(), strict=True)
    return [
        TimedPose(frame_index, timestamp_ns, Pose.from_quat(row[:3], row[3:]))
        for (frame_index, timestamp_ns), row in zip(stamps, _poses(table), strict=True)
    ]
