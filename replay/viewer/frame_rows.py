"""What each frame of one result adds to a recording, row by row; for files and live streams."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from pipeline.geometry import Array, Pose
from pipeline.localizer import FrameResult
from pipeline.markers import MarkerMap
from pipeline.tracker import TrackState
from recorder.files.truth_file import Truth
from recorder.log.records import LogImage
from replay.accuracy import distance_to_path
from replay.viewer import columns, scene, style
from replay.viewer.drive import WholeDrive
from replay.viewer.extent import InnovationLimit
from replay.viewer.layout import Eye, ResultLayout
from replay.viewer.result_style import RAW_FIX
from replay.viewer.status import StatusEvents
from replay.viewer.thinning import MOST_ROWS


class FrameRows:
    """Collects frames' rows in `buffer`; images and changes of status go out at once.

    Attributes:
        plots: the kinds that there are so far.
        drive: positions so far.
        frames: how many; `timed`: for how many of them the truth is known.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        result_name: str,
        marker_map: MarkerMap,
        tracker_names: Sequence[str],
        truth: Truth | None,
        *,
        drive_points: int = MOST_ROWS,
    ) -> None:
        """`drive_points`: so many positions of each tracker are kept to be drawn; even."""
        self._stream, self._map, self._truth = stream, marker_map, truth
        self._status = StatusEvents(result_name)
        self.paths = style.ResultPaths(result_name)
        self.looks = style.tracker_looks(tracker_names)
        self.buffer = columns.ColumnBuffer(stream)
        self.drive = WholeDrive(tracker_names, drive_points)
        self.limits = {name: InnovationLimit() for name in tracker_names}
        self.plots: set[str] = set()
        self.max_markers = 0
        self.frames = self.timed = 0

    def add(
        self,
        time_ns: int,
        image: LogImage,
        result: FrameResult,
        exact: Pose | None,
        measured: tuple[float, float] | None,
    ) -> None:
        """One frame at a time since the log's first image.

        Args:
            exact: T_map_camera where it is known.
            measured: x, y in map where someone measured them; counts where `exact` is None.
        """
        scene.set_time(self._stream, time_ns, image.frame_index)
        self.buffer.at(time_ns, image.frame_index)
        if result.fix.status == "undecodable":
            scene.clear_image(self._stream)
        else:
            scene.log_image(self._stream, image.data, image.format)
        self._add_detections(result)
        self._add_fix(result)
        for name, track in result.tracks.items():
            self._add_track(name, track)
        if exact is not None:
            self.drive.add_exact(exact.translation)
            self._add_errors(result, exact.translation[:2])
        else:
            self._add_errors(result, None if measured is None else np.array(measured))
        for level, message in self._status.changes(result):
            scene.log_event(self._stream, self.paths.events, message, level)
        self.frames += 1

    def layout(self, eye: Eye) -> ResultLayout:
        """What the layout has to know."""
        return ResultLayout(
            self.paths.name,
            tuple(self.looks),
            tuple(sorted(self.plots)),
            {name: limit.value() for name, limit in self.limits.items()},
            self.max_markers,
            eye,
        )

    def _add_detections(self, result: FrameResult) -> None:
        detections, fix = result.detections, result.fix
        used = set(fix.used_ids)
        colours, labels = [], []
        for marker_id in detections.ids.tolist():
            if marker_id in used:
                colours.append(style.USED_COLOUR)
                labels.append(str(marker_id))
            elif marker_id in self._map.by_id:
                colours.append(style.UNUSED_COLOUR)
                labels.append(f"{marker_id} not used")
            else:
                colours.append(style.UNKNOWN_COLOUR)
                labels.append(f"{marker_id} not in map")
        corners = style.to_rerun_pixels(detections.corners_px)
        self.buffer.add(self.paths.detections, columns.outlines, (corners, colours))
        # Below the marker: on its pattern no text can be read.
        below = np.stack([corners[..., 0].mean(axis=1), corners[..., 1].max(axis=1)], axis=1)
        self.buffer.add(self.paths.labels, columns.labels2d, (below, colours, labels))
        corner_colours = [
            c for colour in colours for c in (style.FIRST_CORNER_COLOUR, *[colour] * 3)
        ]
        row = (corners.reshape(-1, 2), corner_colours)
        self.buffer.add(self.paths.corners, columns.points2d, row)
        self._plot("markers", "detected", fix.n_detected)
        self._plot("markers", "used", fix.n_used)
        self.max_markers = max(self.max_markers, fix.n_detected)

    def _add_fix(self, result: FrameResult) -> None:
        pose = result.fix.T_map_camera
        if pose is not None and not pose.is_finite():
            pose = None
        if pose is not None and result.fix.status != "ok":
            self.drive.add_rejected(pose.translation)
            pose = None
        if pose is not None:
            self.drive.add_fix(pose.translation)
        # Without a pose the camera is not to be seen where the last one was.
        self.buffer.add(style.CAMERA, columns.transforms, pose)
        self.buffer.add(self.paths.camera, columns.transforms, pose)

    def _add_track(self, name: str, track: TrackState) -> None:
        xy = track.x[[0, 2]]
        if not np.isfinite(xy).all():
            return
        point = self.drive.add_track(name, xy)
        entity = self.paths.tracker(name)
        self.buffer.add(f"{entity}/position", columns.points3d, point)
        row = (point, track.P[np.ix_([0, 2], [0, 2])])
        self.buffer.add(f"{entity}/ellipse", columns.ellipsoids, row)
        if not np.isfinite(track.nis):
            return
        self._plot("nis", name, track.nis)
        self.plots.add("innovation")
        self.limits[name].add(track.innovation_m, track.innovation_var_m2)
        for k, axis in enumerate(("x", "y")):
            row_k = (track.innovation_m[k], track.innovation_var_m2[k])
            self.buffer.add(self.paths.innovation(name, axis), columns.measurements, row_k)

    def _add_errors(self, result: FrameResult, true_xy: Array | None) -> None:
        self.timed += true_xy is not None
        path = self._truth.path if self._truth else None
        found = {name: track.x[[0, 2]] for name, track in result.tracks.items()}
        fix = result.fix
        if fix.status == "ok" and fix.T_map_camera is not None:
            found[RAW_FIX] = fix.T_map_camera.translation[:2]
        for name, xy in found.items():
            if not np.isfinite(xy).all():
                continue
            if true_xy is not None:
                self._plot("error", name, float(np.hypot(*(xy - true_xy))))
            if path is not None:
                self.plots.add("path_distance")
                entity = self.paths.plot("path_distance", name)
                self.buffer.add(entity, self._path_distances, xy)

    def _path_distances(self, xy_rows: list[Array]) -> rr.ComponentColumnList:
        """Rows: x, y (2,); all at once, as one by one costs more than everything else."""
        if self._truth is None or self._truth.path is None:
            return columns.scalars([])
        return columns.scalars(distance_to_path(np.array(xy_rows), self._truth.path).tolist())

    def _plot(self, kind: str, series: str, value: float) -> None:
        self.plots.add(kind)
        self.buffer.add(self.paths.plot(kind, series), columns.scalars, float(value))
