"""Frames that are being recorded, through the pipeline, in their order."""

from __future__ import annotations

import itertools
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import NamedTuple, Self

import cv2
import numpy as np

from pipeline.detection import Detections
from pipeline.geometry import Pose
from pipeline.localizer import FrameResult, PipelineSettings
from recorder.log.records import ExactPose, LogImage
from recorder.sources.base import CapturedFrame
from replay.inputs import Inputs
from replay.live.gate import Admission
from replay.live.latency import Latencies
from replay.result_run import ResultRun, Tally
from replay.stages import DetectedImage, DetectorPool, opencv_threads


@dataclass(frozen=True)
class Situation:
    """Where the robot is, by the last frame; NaN where that is not known."""

    status: str
    n_used: int = 0
    x_m: float = math.nan
    y_m: float = math.nan
    yaw_rad: float = math.nan


class _OnItsWay(NamedTuple):
    frame: CapturedFrame
    detections: Future[Detections | None]
    since_ns: int


class LiveTracking:
    """Tracks frames as they are handed over, ahead in threads; use it in a `with` block.

    When the block ends, everything that was handed over is in the tables of `folder`.

    Attributes:
        latencies: from `since` to the track.
        situation: after the last frame.
        error: what stopped it.
        rrd_problem: why there is no Rerun file, where there was to be one.
    """

    def __init__(
        self,
        folder: Path,
        inputs: Inputs,
        settings: PipelineSettings,
        *,
        name: str,
        log_name: str,
        rrd: bool,
        jobs: int,
        admission: Admission,
        from_capture: bool,
        on_result: Callable[[CapturedFrame, FrameResult], None] | None = None,
    ) -> None:
        """
        Args:
            from_capture: latencies count from a frame's capture, else from its being handed over.
            on_result: called after each frame; must return at once.
        """
        self._folder, self._inputs, self._settings = folder, inputs, settings
        self._name, self._log_name, self._rrd = name, log_name, rrd
        self._jobs = jobs
        self._admission = admission
        self._from_capture = from_capture
        self._on_result = on_result
        self._waiting: queue.SimpleQueue[_OnItsWay | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="track", daemon=True)
        self._open = ExitStack()
        self.latencies = Latencies()
        self.situation = Situation("no frame yet")
        self.tally = Tally()
        self.error: BaseException | None = None
        self.rrd_problem: str | None = None

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(opencv_threads(1 if self._jobs > 1 else None))
            self._pool = stack.enter_context(
                DetectorPool(
                    self._inputs.camera,
                    lambda: self._settings.detector.build(self._inputs.marker_map),
                    self._jobs,
                )
            )
            self._open = stack.pop_all()
        self._rehearse()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._waiting.put(None)
        self._thread.join()
        self._open.close()

    def _rehearse(self) -> None:
        """Everything once with nothing: what is slow only the first time is not to hit a frame."""
        blank = np.zeros(self._inputs.camera.image_size[::-1], np.uint8)
        data = cv2.imencode(".jpg", blank)[1].tobytes()
        detections = self._pool.submit(data).result()
        item = DetectedImage(LogImage(0, 0, 0, data, "jpeg"), None, detections)
        with (
            TemporaryDirectory(dir=self._folder) as folder,
            self._result_run(Path(folder), 0) as run,
        ):
            run.keep(item, run.localize(item))

    def _result_run(self, folder: Path, start_ns: int) -> ResultRun:
        return ResultRun(
            folder,
            self._inputs,
            self._settings,
            start_ns,
            name=self._name,
            log_name=self._log_name,
            recording_id=f"{self._name} as it came in" if self._rrd else None,
        )

    def submit(self, frame: CapturedFrame) -> None:
        """The next frame of the log; returns at once. After an error it is not tracked."""
        if self.error is not None:
            return
        since_ns = frame.timestamp_ns if self._from_capture else time.time_ns()
        try:
            detections = self._pool.submit(frame.data)
        except Exception as error:
            # It is called by who writes the log, and must not end that.
            self._fail(error)
        else:
            self._waiting.put(_OnItsWay(frame, detections, since_ns))

    def _run(self) -> None:
        # It knows its end: after the last one it does not wait for another.
        items: Iterator[_OnItsWay] = iter(self._waiting.get, None)
        try:
            self._track_all(items)
        except BaseException as error:
            self._fail(error)
            for _ in items:
                pass

    def _fail(self, error: BaseException) -> None:
        self.error = self.error or error
        self.situation = Situation("tracking failed")
        # Whoever waits for a place is not to wait for ever.
        self._admission.close(str(error) or type(error).__name__)

    def _track_all(self, items: Iterator[_OnItsWay]) -> None:
        first = next(items, None)
        if first is None:
            return
        run = self._result_run(self._folder, first.frame.timestamp_ns)
        self.tally = run.tally
        with run:
            for item in itertools.chain([first], items):
                self._track(run, item)
        self.rrd_problem = run.rrd_problem

    def _track(self, run: ResultRun, item: _OnItsWay) -> None:
        frame = item.frame
        detected = DetectedImage(_image(frame), _exact(frame), item.detections.result())
        result = run.localize(detected)
        self.latencies.add((time.time_ns() - item.since_ns) / 1e6)
        self.situation = _situation(result)
        if self._on_result is not None:
            self._on_result(frame, result)
        run.keep(detected, result)
        self._admission.leave(len(frame.data))


def _situation(result: FrameResult) -> Situation:
    """Position of the first tracker; it knows no heading: that is the pose's."""
    track = next(iter(result.tracks.values()))
    fix = result.fix
    good = fix.status == "ok" and fix.T_map_camera is not None
    yaw_rad = fix.T_map_camera.yaw_rad if good and fix.T_map_camera is not None else math.nan
    return Situation(fix.status, fix.n_used, float(track.x[0]), float(track.x[2]), yaw_rad)


def _image(frame: CapturedFrame) -> LogImage:
    stamps = (frame.timestamp_ns, frame.arrival_ns)
    return LogImage(frame.frame_index, *stamps, frame.data, frame.format)


def _exact(frame: CapturedFrame) -> ExactPose | None:
    """The pose as it will be read from the log: to the last bit, that is another one."""
    pose = frame.T_map_camera
    if pose is None:
        return None
    read = Pose.from_quat(pose.translation, pose.quat_xyzw)
    return ExactPose(frame.frame_index, frame.timestamp_ns, read)
