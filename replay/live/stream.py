"""What the viewer shows of a recording that is going on."""

from __future__ import annotations

import rerun as rr

from pipeline.geometry import Pose
from pipeline.localizer import FrameResult
from recorder.image_header import image_fault
from recorder.log.derived import Known
from recorder.log.records import LogImage
from replay.truth import MeasuredTruth
from replay.viewer import scene
from replay.viewer.frame_rows import FrameRows
from replay.viewer.layout import LOG_ASPECT, eye_on, log_layout, results_layout
from replay.viewer.result_style import log_cameras, log_styles

NAME = "live"
# Plots that every drive has; those that compare with a truth come when there is one.
_PLOTS = frozenset({"nis", "innovation", "markers"})
# The drive so far is drawn anew now and then, always whole; more points cost more than they show.
_DRIVE_NS = 500_000_000
_DRIVE_POINTS = 4000
# After so many frames it is known from where to look.
_FRAMES_TO_LOOK_AT = (1, 20)


class LiveImages:
    """The image alone, where it is not known what the camera is or where markers are."""

    def __init__(self, stream: rr.RecordingStream, start_ns: int) -> None:
        self._stream, self._start_ns = stream, start_ns
        eye = eye_on(aspect=LOG_ASPECT)
        stream.send_blueprint(log_layout(eye, has_pose=False, has_scene=False, live=True))

    def show(self, image: LogImage) -> None:
        scene.set_time(self._stream, image.timestamp_ns - self._start_ns, image.frame_index)
        if image_fault(image.data, image.format) is None:
            scene.log_image(self._stream, image.data, image.format)


class LiveDrive:
    """Image, detections, pose and tracks, each frame at once, as a replay shows them."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        known: Known,
        tracker_names: tuple[str, ...],
        start_ns: int,
    ) -> None:
        """`known`: with camera and map."""
        if known.camera is None or known.marker_map is None:
            raise ValueError("expected a camera and a map")
        self._stream, self._start_ns = stream, start_ns
        self._camera, self._map, self._truth = known.camera, known.marker_map, known.truth
        self._measured = MeasuredTruth(known.truth, start_ns)
        self._rows = FrameRows(
            stream, NAME, self._map, tracker_names, known.truth, drive_points=_DRIVE_POINTS
        )
        self._styled: set[str] = set()
        self._drawn_ns: int | None = None
        scene.log_map(stream, self._map)

    def show(self, image: LogImage, result: FrameResult, exact: Pose | None) -> None:
        rows = self._rows
        measured = next(self._measured.at(image.frame_index, image.timestamp_ns), None)
        measured_xy = measured.position_m[:2] if measured else None
        rows.add(image.timestamp_ns - self._start_ns, image, result, exact, measured_xy)
        rows.buffer.flush()
        since_ns = 0 if self._drawn_ns is None else image.timestamp_ns - self._drawn_ns
        look = rows.frames in _FRAMES_TO_LOOK_AT or not rows.plots <= self._styled
        if look or not 0 <= since_ns < _DRIVE_NS:
            self._drawn_ns = image.timestamp_ns
            self._draw(look=look)

    def _draw(self, *, look: bool) -> None:
        """Draws the drive so far; `look`: from where is best, with the plots that there are."""
        rows, stream = self._rows, self._stream
        eye = rows.drive.eye(self._map.corners_m(self._map.ids))
        if look:
            rows.plots |= _PLOTS
            self._styled |= rows.plots
            log_styles(stream, rows.paths, rows.looks, rows.plots)
            log_cameras(stream, rows.paths, rows.looks, self._camera, eye)
            stream.send_blueprint(results_layout([rows.layout(eye)], live=True))
        rows.drive.log(stream, rows.paths, rows.looks, self._truth, eye.radius_m)
