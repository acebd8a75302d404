"""A log that was not replayed, as a Rerun recording with a layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.geometry import Array
from recorder.image_header import image_fault
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from replay.stages import pair
from replay.viewer import columns, scene, style
from replay.viewer.events import LogEvents
from replay.viewer.layout import LOG_ASPECT, eye_on, log_layout
from replay.viewer.output import RecordingFile
from replay.viewer.thinning import Thinned


def convert(log: Path, rrd: Path) -> str | None:
    """Writes what the log holds (images, camera, markers, truth, events) into `rrd`.

    Returns:
        Why the log holds less than was to be recorded, if it does.

    Raises:
        InputError: the log is not one.
    """
    with LogReader(log) as reader:
        file = RecordingFile(rrd, reader.sha256(), log.stem)
        try:
            _write(reader, file)
        except BaseException:
            file.discard()
            raise
        file.close()
        return reader.shortfall


def _write(reader: LogReader, file: RecordingFile) -> None:
    stream = file.stream
    marker_map = reader.marker_map()
    if marker_map is not None:
        scene.log_map(stream, marker_map)
    exact_m = _write_records(reader, file)
    markers_m = np.empty((0, 3)) if marker_map is None else marker_map.corners_m(marker_map.ids)
    eye = eye_on(markers_m, exact_m, aspect=LOG_ASPECT)
    camera = reader.camera()
    if camera is not None:
        pinhole = scene.pinhole(camera, 0.25 * eye.radius_m, style.CAMERA_COLOUR)
        stream.log(style.CAMERA, pinhole, static=True)
    truth = reader.truth()
    if truth is not None:
        scene.log_truth(stream, truth, float(np.median(exact_m[:, 2])) if len(exact_m) else 0.0)
    if len(exact_m):
        scene.log_line(stream, style.TRUTH_EXACT, exact_m, style.TRUTH_COLOUR)
    layout = log_layout(
        eye,
        has_pose=camera is not None and len(exact_m) > 0,
        has_scene=marker_map is not None or truth is not None or len(exact_m) > 0,
    )
    stream.send_blueprint(layout)


def _write_records(reader: LogReader, file: RecordingFile) -> Array:
    """Images, exact poses and events; returns some of the exact positions (N, 3)."""
    stream, start_ns = file.stream, reader.start_ns
    if start_ns is None:
        start_ns = next((record.timestamp_ns for record in reader.records()), 0)
    buffer = columns.ColumnBuffer(stream)
    events = LogEvents(stream, start_ns)
    positions = Thinned(3)
    for record in pair(reader.records()):
        if isinstance(record, LogEvent):
            events.add(record)
            continue
        image = record.image
        events.frame(image.timestamp_ns, image.frame_index)
        time_ns = image.timestamp_ns - start_ns
        scene.set_time(stream, time_ns, image.frame_index)
        if image_fault(image.data, image.format) is None:
            scene.log_image(stream, image.data, image.format)
        else:
            scene.clear_image(stream)
        T_map_camera = record.exact.T_map_camera if record.exact else None
        buffer.at(time_ns, image.frame_index)
        buffer.add(style.CAMERA, columns.transforms, T_map_camera)
        if T_map_camera is not None:
            positions.add(*T_map_camera.translation.tolist())
    events.flush()
    buffer.flush()
    return positions.rows()
