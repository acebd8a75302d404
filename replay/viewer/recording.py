"""The Rerun recording of one replay, written frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import rerun as rr

from pipeline.camera import Camera
from pipeline.geometry import Array, Pose
from pipeline.localizer import FrameResult
from pipeline.markers import MarkerMap
from pipeline.tracker import TrackState
from recorder.files.truth_file import Truth
from recorder.log.reader import LogEvent, LogImage
from replay.accuracy import distance_to_path
from replay.viewer import columns, scene, style
from replay.viewer.drive import WholeDrive
from replay.viewer.events import LogEvents
from replay.viewer.extent import InnovationLimit
from replay.viewer.layout import ResultLayout, results_layout
from replay.viewer.output import RecordingFile
from replay.viewer.result_style import RAW_FIX, log_styles
from replay.viewer.status import StatusEvents

# χ² with two degrees of freedom stays below this in 95 % of the cases.
NIS_BOUND = 5.991


class ReplayRecording:
    """Writes one replay's `replay.rrd`; a context manager that leaves a finished file or none.

    Recordings of the same log share application and recording id, so that the viewer overlays them.
    """

    def __init__(
        self,
        path: Path,
        *,
        log_id: str,
        result_name: str,
        camera: Camera,
        marker_map: MarkerMap,
        tracker_names: Sequence[str],
        start_ns: int,
        truth: Truth | None = None,
        log_name: str | None = None,
    ) -> None:
        """
        Args:
            log_id: SHA-256 of the log.
            start_ns: capture stamp of the log's first image, where its seconds count from.
            log_name: what the viewer calls the recording.
        """
        self._paths = style.ResultPaths(result_name)
        self._camera, self._map, self._truth = camera, marker_map, truth
        self._start_ns = start_ns
        self._status = StatusEvents(result_name)
        self._looks = style.tracker_looks(tracker_names)
        self._plots: set[str] = set()
        self._frames = 0
        self._timed = 0
        self._span: list[tuple[int, int]] = []
        self._drive = WholeDrive(tracker_names)
        self._limits = {name: InnovationLimit() for name in tracker_names}
        self._max_markers = 0
        self._file = RecordingFile(path, log_id, log_name or "log")
        self._stream = self._file.stream
        self._buffer = columns.ColumnBuffer(self._stream)
        self._events = LogEvents(self._stream, start_ns)
        scene.log_map(self._stream, marker_map)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._file.discard()
            return
        self.close()

    def log_frame(
        self,
        image: LogImage,
        result: FrameResult,
        exact: Pose | None = None,
        measured: tuple[float, float] | None = None,
    ) -> None:
        """One replayed frame.

        Args:
            exact: T_map_camera where the log knows it.
            measured: x, y in map where someone measured them; counts where `exact` is None.
        """
        self._events.frame(image.timestamp_ns, image.frame_index)
        time_ns = image.timestamp_ns - self._start_ns
        scene.set_time(self._stream, time_ns, image.frame_index)
        self._buffer.at(time_ns, image.frame_index)
        if result.fix.status == "undecodable":
            scene.clear_image(self._stream)
        else:
            scene.log_image(self._stream, image.data, image.format)
        self._add_detections(result)
        self._add_fix(result)
        for name, track in result.tracks.items():
            self._add_track(name, track)
        if exact is not None:
            self._drive.add_exact(exact.translation)
            self._add_errors(result, exact.translation[:2])
        else:
            self._add_errors(result, None if measured is None else np.array(measured))
        for level, message in self._status.changes(result):
            scene.log_event(self._stream, self._paths.events, message, level)
        self._span = [*self._span[:1], (time_ns, image.frame_index)]
        self._frames += 1

    def log_event(self, event: LogEvent) -> None:
        """One event of the log itself."""
        self._events.add(event)

    def close(self) -> None:
        """Writes what takes the whole replay to know, and gives the file its name."""
        try:
            self._finish()
        except BaseException:
            self._file.discard()
            raise
        self._file.close()

    def _finish(self) -> None:
        # Truth at every frame says all that the distance to the path could.
        if self._timed > self._frames / 2:
            self._plots.discard("path_distance")
        if "nis" in self._plots:
            for time_ns, frame_index in self._span:
                self._buffer.at(time_ns, frame_index)
                self._buffer.add(self._paths.plot("nis", "bound"), columns.scalars, NIS_BOUND)
        self._buffer.flush()
        self._events.flush()
        log_styles(self._stream, self._paths, self._looks, self._plots)
        eye = self._drive.eye(self._map.corners_m(self._map.ids))
        self._drive.log(self._stream, self._paths, self._looks, self._truth, eye.radius_m)
        # Small enough not to hide the trajectories behind it.
        distance_m = 0.12 * eye.radius_m
        pinhole = scene.pinhole(self._camera, distance_m, style.CAMERA_COLOUR)
        self._stream.log(style.CAMERA, pinhole, static=True)
        first = next(iter(self._looks.values()))
        own = scene.pinhole(self._camera, distance_m, first.colour)
        self._stream.log(self._paths.camera, own, static=True)
        layout = ResultLayout(
            self._paths.name,
            tuple(self._looks),
            tuple(sorted(self._plots)),
            {name: limit.value() for name, limit in self._limits.items()},
            self._max_markers,
            eye,
        )
        self._stream.log(self._paths.summary, rr.TextDocument(layout.to_json()), static=True)
        self._stream.send_blueprint(results_layout([layout]))

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
        self._buffer.add(self._paths.detections, columns.outlines, (corners, colours))
        # Below the marker: on its pattern no text can be read.
        below = np.stack([corners[..., 0].mean(axis=1), corners[..., 1].max(axis=1)], axis=1)
        self._buffer.add(self._paths.labels, columns.labels2d, (below, colours, labels))
        corner_colours = [
            c for colour in colours for c in (style.FIRST_CORNER_COLOUR, *[colour] * 3)
        ]
        row = (corners.reshape(-1, 2), corner_colours)
        self._buffer.add(self._paths.corners, columns.points2d, row)
        self._plot("markers", "detected", fix.n_detected)
        self._plot("markers", "used", fix.n_used)
        self._max_markers = max(self._max_markers, fix.n_detected)

    def _add_fix(self, result: FrameResult) -> None:
        pose = result.fix.T_map_camera
        if pose is not None and not pose.is_finite():
            pose = None
        if pose is not None and result.fix.status != "ok":
            self._drive.add_rejected(pose.translation)
            pose = None
        if pose is not None:
            self._drive.add_fix(pose.translation)
        # Without a pose the camera is not to be seen where the last one was.
        self._buffer.add(style.CAMERA, columns.transforms, pose)
        self._buffer.add(self._paths.camera, columns.transforms, pose)

    def _add_track(self, name: str, track: TrackState) -> None:
        xy = track.x[[0, 2]]
        if not np.isfinite(xy).all():
            return
        point = self._drive.add_track(name, xy)
        entity = self._paths.tracker(name)
        self._buffer.add(f"{entity}/position", columns.points3d, point)
        row = (point, track.P[np.ix_([0, 2], [0, 2])])
        self._buffer.add(f"{entity}/ellipse", columns.ellipsoids, row)
        if not np.isfinite(track.nis):
            return
        self._plot("nis", name, track.nis)
        self._plots.add("innovation")
        self._limits[name].add(track.innovation_m, track.innovation_var_m2)
        for k, axis in enumerate(("x", "y")):
            row_k = (track.innovation_m[k], track.innovation_var_m2[k])
            self._buffer.add(self._paths.innovation(name, axis), columns.measurements, row_k)

    def _add_errors(self, result: FrameResult, true_xy: Array | None) -> None:
        self._timed += true_xy is not None
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
                self._plots.add("path_distance")
                entity = self._paths.plot("path_distance", name)
                self._buffer.add(entity, self._path_distances, xy)

    def _path_distances(self, xy_rows: list[Array]) -> rr.ComponentColumnList:
        """Rows: x, y (2,); all at once, as one by one costs more than everything else."""
        if self._truth is None or self._truth.path is None:
            return columns.scalars([])
        return columns.scalars(distance_to_path(np.array(xy_rows), self._truth.path).tolist())

    def _plot(self, kind: str, series: str, value: float) -> None:
        self._plots.add(kind)
        self._buffer.add(self._paths.plot(kind, series), columns.scalars, float(value))
