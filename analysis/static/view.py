"""What a camera that stands still saw: its detections, frame by frame, and where it stood."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array
from pipeline.markers import MarkerMap
from pipeline.pose import RansacIterative
from pipeline.selection import usable
from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map
from recorder.files.yaml_file import read_bytes
from replay.result import Result, open_result

if TYPE_CHECKING:
    import pandas as pd

# More than this between its places, and the camera did not stand still.
MAX_MOTION_M = 0.05

# Enough markers for a pose that shows whether the camera moved.
_STEADY_MARKERS = 4


class MovedError(InputError):
    """The camera did not stand still."""


@dataclass(frozen=True, eq=False)
class StillFrame:
    """One frame's known markers, each seen once.

    Attributes:
        time_s: seconds after the result's first frame.
        truth: (3,) x m, y m, yaw rad of the camera; NaN where unknown.
    """

    frame_index: int
    time_s: float
    detections: Detections
    truth: Array

    @property
    def has_truth(self) -> bool:
        """The position is known; the heading may not be."""
        return bool(np.isfinite(self.truth[:2]).all())


@dataclass(frozen=True, eq=False)
class StillView:
    """One result of a camera standing still.

    Attributes:
        frames: those with at least one known marker.
        truth_kind: what the errors are against; None without a truth.
        height_m: distance from the camera to the markers (mean over them, along their normals);
            NaN where neither truth nor pose gives it.
    """

    result: Result
    camera: Camera
    marker_map: MarkerMap
    frames: tuple[StillFrame, ...]
    truth_kind: Literal["exact", "measured"] | None
    height_m: float

    @cached_property
    def ids(self) -> tuple[int, ...]:
        """Every marker seen, ascending."""
        return tuple(sorted({int(i) for frame in self.frames for i in frame.detections.ids}))

    @property
    def solver(self) -> RansacIterative:
        """The result's own solver, without a limit on the number of markers."""
        return self.result.settings.pose.model_copy(update={"max_markers": None})

    @cached_property
    def centre_distance_px(self) -> dict[int, float]:
        """Each marker's distance from the image centre, mean over frames."""
        distances: dict[int, list[float]] = {i: [] for i in self.ids}
        for frame in self.frames:
            centres = frame.detections.corners_px.mean(axis=1)
            far = np.linalg.norm(centres - self.camera.image_centre_px, axis=1)
            for marker_id, distance in zip(frame.detections.ids.tolist(), far, strict=True):
                distances[marker_id].append(float(distance))
        return {marker_id: float(np.mean(d)) for marker_id, d in distances.items()}

    def common_ids(self, frames: tuple[StillFrame, ...]) -> tuple[int, ...]:
        """The markers seen in all of `frames`, ascending."""
        common = set(self.ids)
        for frame in frames:
            common &= {int(i) for i in frame.detections.ids}
        return tuple(sorted(common))

    @property
    def truth_note(self) -> str:
        if self.truth_kind is None:
            return "no truth: only the spread about the mean is given"
        known = sum(frame.has_truth for frame in self.frames)
        whose = "each frame" if known == len(self.frames) else f"{known} of the frames"
        return f"errors against the {self.truth_kind} truth of {whose}"


def open_view(folder: Path) -> StillView:
    """The view of a replay's result.

    Raises:
        InputError: no result, no known marker in it, or the camera moved.
    """
    result = open_result(folder)
    camera_path, map_path = folder / "camera.yaml", folder / "map.yaml"
    camera = parse_camera(read_bytes(camera_path), camera_path)
    marker_map = parse_map(read_bytes(map_path), map_path)
    truth, kind = _truth(result)
    frames = _frames(result, marker_map, truth)
    if not frames:
        raise InputError(folder, "expected detections of markers of the map, found none")
    poses = result.table("poses")
    _check_still(result, frames, poses)
    if not any(frame.has_truth for frame in frames):
        # A truth of other frames says nothing about these.
        truth = kind = None
    return StillView(result, camera, marker_map, frames, kind, _height_m(marker_map, truth, poses))


def _frames(
    result: Result, marker_map: MarkerMap, truth: pd.DataFrame | None
) -> tuple[StillFrame, ...]:
    table = result.table("detections")
    corner = table["corner"].to_numpy()
    if len(table) % 4 or not np.array_equal(corner, np.tile([0, 1, 2, 3], len(table) // 4)):
        raise InputError(
            result.folder / "detections.parquet", "expected corners 0 to 3 of each marker in order"
        )
    index = table["frame_index"].to_numpy()[::4]
    stamps = table["timestamp_ns"].to_numpy()[::4]
    ids = table["marker_id"].to_numpy().astype(np.int64)[::4]
    corners = table[["u_px", "v_px"]].to_numpy().astype(np.float64).reshape(-1, 4, 2)
    # Seconds only choose the markers that a limit in the settings lets through.
    first_ns = int(result.table("poses")["timestamp_ns"].iloc[0]) if len(index) else 0
    places = {} if truth is None else _by_frame(truth)
    nowhere = np.full(3, np.nan)
    frames = []
    changes = np.flatnonzero(index[1:] != index[:-1]) + 1
    for rows in np.split(np.arange(len(index)), changes) if len(index) else ():
        seen = usable(Detections(ids[rows], corners[rows]), marker_map).detections
        if len(seen):
            order = np.argsort(seen.ids, kind="stable")
            number = int(index[rows[0]])
            time_s = (int(stamps[rows[0]]) - first_ns) * 1e-9
            frames.append(
                StillFrame(number, time_s, seen.select(order), places.get(number, nowhere))
            )
    return tuple(frames)


def _truth(result: Result) -> tuple[pd.DataFrame | None, Literal["exact", "measured"] | None]:
    """Timed truth at frames: exact where there is any, else measured."""
    if not (result.folder / "truth.parquet").exists():
        return None, None
    table = result.table("truth")
    table = table[table["frame_index"] >= 0]
    kind: Literal["exact", "measured"]
    for kind in ("exact", "measured"):
        rows = table[table["kind"] == kind]
        if len(rows):
            return rows, kind
    return None, None


def _by_frame(truth: pd.DataFrame) -> dict[int, Array]:
    values = truth[["x_m", "y_m", "yaw_rad"]].to_numpy().astype(np.float64)
    return dict(zip(truth["frame_index"].astype(int).tolist(), values, strict=True))


def _check_still(result: Result, frames: tuple[StillFrame, ...], poses: pd.DataFrame) -> None:
    """By the truth where every frame has one; one stand measured on a drive says nothing."""
    if all(frame.has_truth for frame in frames):
        motion_m = float(np.ptp([frame.truth[:2] for frame in frames], axis=0).max())
    else:
        steady = poses[(poses["status"] == "ok") & (poses["n_used"] >= _STEADY_MARKERS)]
        places = steady[["x_m", "y_m"]].to_numpy().astype(np.float64)
        if len(places) < 2:
            return
        # Without truth a pose may be far off by itself: the middle nine tenths decide.
        motion_m = float(np.ptp(np.quantile(places, (0.05, 0.95), axis=0), axis=0).max())
    if motion_m > MAX_MOTION_M:
        raise MovedError(
            result.folder,
            f"expected a camera that stands still, found one that moved {motion_m:.2f} m; "
            "replay a part of the log with --from and --to",
        )


def _height_m(marker_map: MarkerMap, truth: pd.DataFrame | None, poses: pd.DataFrame) -> float:
    places = np.empty((0, 3))
    if truth is not None:
        places = truth[["x_m", "y_m", "z_m"]].to_numpy().astype(np.float64)
        places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        ok = poses[poses["status"] == "ok"]
        places = ok[["x_m", "y_m", "z_m"]].to_numpy().astype(np.float64)
    if not len(places):
        return float("nan")
    place = np.median(places, axis=0)
    heights: npt.NDArray[np.float64] = np.array(
        [abs(m.normal @ (place - m.centre_m)) for m in marker_map.markers]
    )
    return float(heights.mean())
