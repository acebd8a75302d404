"""The Rerun recording of one replay, written frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import rerun as rr

from pipeline.camera import Camera
from pipeline.geometry import Pose
from pipeline.localizer import FrameResult
from pipeline.markers import MarkerMap
from recorder.files.truth_file import Truth
from recorder.log.records import LogEvent, LogImage
from replay.viewer import columns, scene
from replay.viewer.events import LogEvents
from replay.viewer.frame_rows import FrameRows
from replay.viewer.layout import results_layout
from replay.viewer.output import RecordingFile
from replay.viewer.result_style import log_cameras, log_styles

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
        self._camera, self._map, self._truth = camera, marker_map, truth
        self._start_ns = start_ns
        self._span: list[tuple[int, int]] = []
        self._file = RecordingFile(path, log_id, log_name or "log")
        self._stream = self._file.stream
        self._rows = FrameRows(self._stream, result_name, marker_map, tracker_names, truth)
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
        self._rows.add(time_ns, image, result, exact, measured)
        self._span = [*self._span[:1], (time_ns, image.frame_index)]

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
        rows, paths, buffer = self._rows, self._rows.paths, self._rows.buffer
        # Truth at every frame says all that the distance to the path could.
        if rows.timed > rows.frames / 2:
            rows.plots.discard("path_distance")
        if "nis" in rows.plots:
            for time_ns, frame_index in self._span:
                buffer.at(time_ns, frame_index)
                buffer.add(paths.plot("nis", "bound"), columns.scalars, NIS_BOUND)
        buffer.flush()
        self._events.flush()
        log_styles(self._stream, paths, rows.looks, rows.plots)
        eye = rows.drive.eye(self._map.corners_m(self._map.ids))
        rows.drive.log(self._stream, paths, rows.looks, self._truth, eye.radius_m)
        log_cameras(self._stream, paths, rows.looks, self._camera, eye)
        layout = rows.layout(eye)
        self._stream.log(paths.summary, rr.TextDocument(layout.to_json()), static=True)
        self._stream.send_blueprint(results_layout([layout]))
