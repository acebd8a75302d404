"""Frames on their way into a result: pose and tracks, tables, Rerun file, counts."""

from __future__ import annotations

import json
import os
from collections import Counter
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from pipeline.localizer import FrameResult, Localizer, PipelineSettings
from pipeline.variance import UnknownVariance
from recorder.errors import InputError
from recorder.log.parts import PartsReader
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.session import git_state
from replay.accuracy import errors, measured_rows
from replay.inputs import Inputs
from replay.result import SUMMARY
from replay.settings_file import settings_yaml
from replay.stages import DetectedImage
from replay.tables import TABLES_VERSION, TableWriter
from replay.truth import MeasuredTruth, exact_row
from replay.versions import versions

if TYPE_CHECKING:
    from replay.viewer.recording import ReplayRecording

RRD = "replay.rrd"


class Tally:
    """What is counted while the frames go by."""

    def __init__(self) -> None:
        self.frames = 0
        self.fallback = 0
        self.status: Counter[str] = Counter()
        self.start_ns = self.end_ns = self._passed_ns = 0

    def add(self, result: FrameResult) -> None:
        if not self.frames:
            self.start_ns = self.end_ns = result.timestamp_ns
        self._passed_ns += max(result.timestamp_ns - self.end_ns, 0)
        self.end_ns = result.timestamp_ns
        self.frames += 1
        self.fallback += result.fix.fallback
        self.status[result.fix.status] += 1

    @property
    def duration_s(self) -> float:
        """From the first capture to the last; where stamps jump back, no time passes."""
        return self._passed_ns * 1e-9


class ResultRun:
    """Writes a result folder's tables and Rerun file, frame by frame; use it in a `with` block.

    The same for a log and for frames that are being recorded. When the block ends, the files are.

    Attributes:
        rrd_problem: why there is no Rerun file, where there was to be one; the tables stand alone.
    """

    def __init__(
        self,
        folder: Path,
        inputs: Inputs,
        settings: PipelineSettings,
        start_ns: int,
        *,
        name: str,
        log_name: str,
        recording_id: str | None,
    ) -> None:
        """
        Args:
            start_ns: capture stamp of the log's first image, where its seconds count from.
            recording_id: of the Rerun file; None: there is none.
        """
        self._localizer = Localizer(settings, inputs.camera, inputs.marker_map, start_ns)
        self._measured = MeasuredTruth(inputs.truth, start_ns)
        self.tally = Tally()
        self.rrd_problem: str | None = None
        with ExitStack() as stack:
            self._tables = stack.enter_context(TableWriter(folder))
            self._recording: ReplayRecording | None = None
            if recording_id is not None:
                from replay.viewer.recording import ReplayRecording

                self._recording = ReplayRecording(
                    folder / RRD,
                    log_id=recording_id,
                    result_name=name,
                    camera=inputs.camera,
                    marker_map=inputs.marker_map,
                    truth=inputs.truth,
                    tracker_names=tuple(settings.trackers),
                    start_ns=start_ns,
                    log_name=log_name,
                )
                stack.push(self._end_recording)
            self._open = stack.pop_all()

    def localize(self, item: DetectedImage) -> FrameResult:
        """Pose and tracks of the next frame."""
        image = item.image
        result = self._localizer.advance(image.frame_index, image.timestamp_ns, item.detections)
        self.tally.add(result)
        return result

    def keep(self, item: DetectedImage, result: FrameResult) -> None:
        """Puts what was found into the files."""
        self._tables.add(result)
        exact = item.exact.T_map_camera if item.exact else None
        if exact is not None:
            self._tables.add_truth(exact_row(result.frame_index, result.timestamp_ns, exact))
        rows = list(self._measured.at(result.frame_index, result.timestamp_ns))
        for row in rows:
            self._tables.add_truth(row)
        if self._recording is not None:
            measured_xy = rows[0].position_m[:2] if rows else None
            self._recording.log_frame(item.image, result, exact, measured_xy)

    def event(self, event: LogEvent) -> None:
        """Shows one event of the log."""
        if self._recording is not None:
            self._recording.log_event(event)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.__exit__(kind, error, trace)

    def _end_recording(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        from replay.viewer.output import NotWrittenError

        if self._recording is None:
            return
        try:
            self._recording.__exit__(kind, error, trace)
        except NotWrittenError as problem:
            self.rrd_problem = problem.reason


def not_written_text(error: OSError) -> str:
    """Of a result; without the name of the temporary file."""
    return f"could not be written: {os.strerror(error.errno) if error.errno else error}"


def rrd_problem_text(problem: str) -> str:
    """What to say of a result without the Rerun file that it was to have."""
    return f"could not be written: {problem}; the tables are complete"


def write_inputs(folder: Path, inputs: Inputs, settings: PipelineSettings) -> None:
    """Puts what a result was made with beside it: calibration, map, truth, settings."""
    for file, data in inputs.files.items():
        (folder / file).write_bytes(data)
    (folder / "settings.yaml").write_bytes(settings_yaml(settings, versions()))


def write_summary(
    folder: Path,
    reader: LogReader,
    inputs: Inputs,
    settings: PipelineSettings,
    tally: Tally,
    wall_s: float,
    more: dict[str, Any],
) -> dict[str, Any]:
    """Writes and returns the summary of the tables in `folder`, with `more` in it."""
    path = inputs.truth.path if inputs.truth else None
    summary = {
        **more,
        "log": reader.path.name,
        "log_cut_short": reader.shortfall,
        "tables_version": TABLES_VERSION,
        "versions": versions(),
        "git": git_state(),
        "inputs": {file: sha256(data).hexdigest() for file, data in inputs.files.items()},
        "frames": tally.frames,
        "start_ns": tally.start_ns,
        "end_ns": tally.end_ns,
        "duration_s": tally.duration_s,
        "truth_without_frames": _says_nothing(inputs, folder),
        "truth_problems": list(inputs.truth_problems),
        "status": dict(sorted(tally.status.items())),
        "fallback": tally.fallback,
        "wall_s": round(wall_s, 3),
        "frames_per_second": round(tally.frames / wall_s, 2),
        "errors": errors(folder, path, settings.trackers),
    }
    if isinstance(reader, PartsReader):
        summary["log_parts"] = [path.name for path in reader.paths]
    (folder / SUMMARY).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    return summary


def check_models(settings: PipelineSettings) -> None:
    """A model of someone's own is settings without a call where its class is not defined.

    Raises:
        InputError: there is one.
    """
    for name, tracker in settings.trackers.items():
        if isinstance(tracker.variance, UnknownVariance):
            raise InputError(
                "settings",
                f"expected a built-in kind, found the custom model {tracker.variance.name}, "
                "which only the program that defines it can replay",
                f"trackers.{name}.variance",
            )


def _says_nothing(inputs: Inputs, folder: Path) -> bool:
    """There is a timed truth, and not one frame that it speaks of."""
    truth = inputs.truth
    if truth is None or not (truth.poses or truth.trajectory):
        return False
    return not measured_rows(folder)
