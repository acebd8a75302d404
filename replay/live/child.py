"""The process that draws the live view: whatever happens to it, the recording does not notice."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, NamedTuple

from recorder.sources.base import CapturedFrame

if TYPE_CHECKING:
    import rerun as rr

    from pipeline.camera import Camera
    from pipeline.localizer import Frame, FrameResult, PipelineSettings
    from recorder.log.records import LogImage

# What a viewer has not taken by then, it will not take.
_PATIENCE_S = 10.0
_FLUSH_S = 1.0
_NICE = 10


@dataclass(frozen=True)
class ViewSetup:
    """What the view is of.

    Attributes:
        recording_id: the same after a viewer was lost and came back.
        files: `camera.yaml`, `map.yaml`, `truth.*` of the log.
        settings: what to track with; frames that come with a result need none.
    """

    name: str
    recording_id: str
    files: Mapping[str, bytes]
    settings: PipelineSettings


class Shown(NamedTuple):
    """One frame for the view; `result` where somebody else has tracked it, `start_ns` the capture
    of the log's first."""

    frame: CapturedFrame
    result: FrameResult | None
    start_ns: int


def run(connection: Connection, url: str, setup: ViewSetup) -> None:
    """Shows what comes over `connection`, answering each frame: None, or why that is the end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What Rerun has to say goes to those who can do something about it.
    os.environ["RUST_LOG"] = "off"
    with suppress(AttributeError, OSError):
        os.nice(_NICE)
    code = 1
    try:
        _serve(connection, url, setup)
        code = 0
    except (EOFError, ConnectionError):
        code = 0
    except Exception as error:
        with suppress(OSError):
            connection.send(str(error) or type(error).__name__)
    finally:
        # Rerun would wait, at its end, until the viewer has taken everything.
        os._exit(code)


def _serve(connection: Connection, url: str, setup: ViewSetup) -> None:
    import cv2
    import rerun as rr

    from pipeline.localizer import Localizer
    from recorder.log.derived import Known
    from replay.live.stream import LiveDrive, LiveImages
    from replay.viewer import style

    cv2.setNumThreads(1)
    known = Known.parse(setup.files)
    stream = rr.RecordingStream(
        style.APPLICATION_ID,
        recording_id=setup.recording_id,
        batcher_config=rr.ChunkBatcherConfig.LOW_LATENCY(),
    )
    stream.connect_grpc(url)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.send_recording_name(setup.name)
    shown: Shown = connection.recv()
    if known.camera is None or known.marker_map is None:
        images = LiveImages(stream, shown.start_ns)
        while True:
            images.show(_image(shown.frame))
            _deliver(stream)
            connection.send(None)
            shown = connection.recv()
    drive = LiveDrive(stream, known, tuple(setup.settings.trackers), shown.start_ns)
    localizer = Localizer(setup.settings, known.camera, known.marker_map, shown.start_ns)
    while True:
        result = shown.result or localizer.step(_frame(shown.frame, known.camera))
        drive.show(_image(shown.frame), result, shown.frame.T_map_camera)
        _deliver(stream)
        connection.send(None)
        shown = connection.recv()


def _image(frame: CapturedFrame) -> LogImage:
    from recorder.log.records import LogImage

    stamps = (frame.timestamp_ns, frame.arrival_ns)
    return LogImage(frame.frame_index, *stamps, frame.data, frame.format)


def _frame(frame: CapturedFrame, camera: Camera) -> Frame:
    from pipeline.localizer import Frame
    from recorder.image_decoding import decode_gray

    image = decode_gray(frame.data, camera.image_size)
    return Frame(frame.frame_index, frame.timestamp_ns, image)


def _deliver(stream: rr.RecordingStream) -> None:
    """Waits until the viewer has what was logged, so that no more than one frame is on its way.

    Raises:
        RuntimeError: it takes nothing any more.
    """
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            stream.flush(timeout_sec=_FLUSH_S)
            return
        except RuntimeError as error:
            if "timed out" not in str(error):
                raise RuntimeError("the viewer is gone") from error
            if time.monotonic() > until:
                raise RuntimeError("the viewer takes nothing any more") from error
