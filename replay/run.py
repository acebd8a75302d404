"""One log through the pipeline: tables, summary and a Rerun file."""

from __future__ import annotations

import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
from tqdm import tqdm

from pipeline.localizer import FrameResult, Localizer, PipelineSettings
from pipeline.variance import UnknownVariance
from recorder.errors import InputError
from recorder.log.reader import LogEvent, LogImage, LogReader
from recorder.session import git_state
from replay.accuracy import errors, measured_rows
from replay.inputs import Inputs, Overrides, gather
from replay.result import SUMMARY, new_result
from replay.settings_file import settings_yaml
from replay.stages import DetectedImage, decode, detect_ahead, pair
from replay.tables import TABLES_VERSION, TableWriter
from replay.truth import MeasuredTruth, exact_row
from replay.versions import versions


@dataclass(frozen=True)
class ReplayOptions:
    """How to replay; everything that decides what comes out is in the result.

    Attributes:
        from_s, to_s: seconds of the log, from the first image's capture stamp.
        rrd: write the Rerun file.
        jobs: threads for decoding and detection (None: one per core); the tables are the same.
    """

    settings: PipelineSettings = field(default_factory=PipelineSettings)
    overrides: Overrides = field(default_factory=Overrides)
    from_s: float | None = None
    to_s: float | None = None
    rrd: bool = True
    force: bool = False
    jobs: int | None = None
    progress: bool = True


def replay(log: Path, out: Path, name: str, options: ReplayOptions) -> dict[str, Any]:
    """Replays `log` into the folder `out` and returns its summary.

    Raises:
        InputError: the log, a file or the output is not what it should be; nothing is left behind.
    """
    _check_models(options.settings)
    with LogReader(log) as reader, new_result(out, force=options.force) as folder:
        inputs = gather(reader, options.overrides)
        _check_images(reader, inputs)
        for file, data in inputs.files.items():
            (folder / file).write_bytes(data)
        (folder / "settings.yaml").write_bytes(settings_yaml(options.settings, versions()))
        log_sha256 = reader.sha256()
        started = time.perf_counter()
        tally = _run(reader, inputs, folder, name, log_sha256, options)
        wall_s = time.perf_counter() - started
        if not tally.frames:
            raise InputError(log, f"expected images in {_span(options)}, found none")
        path = inputs.truth.path if inputs.truth else None
        summary = {
            "name": name,
            "log": log.name,
            "log_sha256": log_sha256,
            "log_cut_short": reader.shortfall,
            "tables_version": TABLES_VERSION,
            "versions": versions(),
            "git": git_state(),
            "inputs": {file: sha256(data).hexdigest() for file, data in inputs.files.items()},
            "overrides": sorted(
                key for key, value in vars(options.overrides).items() if value is not None
            ),
            "from_s": options.from_s,
            "to_s": options.to_s,
            "frames": tally.frames,
            "start_ns": tally.start_ns,
            "end_ns": tally.end_ns,
            "duration_s": tally.duration_s,
            "truth_without_frames": _says_nothing(inputs, folder),
            "status": dict(sorted(tally.status.items())),
            "fallback": tally.fallback,
            "wall_s": round(wall_s, 3),
            "frames_per_second": round(tally.frames / wall_s, 2),
            "errors": errors(folder, path, options.settings.trackers),
        }
        (folder / SUMMARY).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    return summary


class _Tally:
    """What is counted while the frames go by."""

    def __init__(self) -> None:
        self.frames = 0
        self.fallback = 0
        self.status: Counter[str] = Counter()
        self.start_ns = self.end_ns = 0

    def add(self, result: FrameResult) -> None:
        if not self.frames:
            self.start_ns = result.timestamp_ns
        self.end_ns = result.timestamp_ns
        self.frames += 1
        self.fallback += result.fix.fallback
        self.status[result.fix.status] += 1

    @property
    def duration_s(self) -> float:
        return (self.end_ns - self.start_ns) * 1e-9


def _run(
    reader: LogReader,
    inputs: Inputs,
    folder: Path,
    name: str,
    log_sha256: str,
    options: ReplayOptions,
) -> _Tally:
    settings = options.settings
    start_ns = reader.start_ns or 0
    localizer = Localizer(settings, inputs.camera, inputs.marker_map, start_ns)
    measured = MeasuredTruth(inputs.truth, start_ns)
    jobs = options.jobs or _cores()
    tally = _Tally()
    with ExitStack() as stack:
        tables = stack.enter_context(TableWriter(folder))
        recording = None
        if options.rrd:
            from replay.viewer.recording import ReplayRecording

            recording = stack.enter_context(
                ReplayRecording(
                    folder / "replay.rrd",
                    log_id=log_sha256,
                    result_name=name,
                    camera=inputs.camera,
                    marker_map=inputs.marker_map,
                    truth=inputs.truth,
                    tracker_names=tuple(settings.trackers),
                    start_ns=start_ns,
                    log_name=reader.path.stem,
                )
            )
        stack.enter_context(_opencv_threads(1 if jobs > 1 else None))
        bar = stack.enter_context(
            tqdm(
                total=None if options.from_s or options.to_s else reader.image_count(),
                unit="frame",
                desc=reader.path.name,
                disable=None if options.progress else True,
                file=sys.stderr,
            )
        )
        records = pair(reader.records(options.from_s, options.to_s))
        for item in detect_ahead(
            records, inputs.camera, lambda: settings.detector.build(inputs.marker_map), jobs
        ):
            if isinstance(item, LogEvent):
                if recording is not None:
                    recording.log_event(item)
                continue
            result = localizer.advance(
                item.image.frame_index, item.image.timestamp_ns, item.detections
            )
            tally.add(result)
            measured_xy = _write(tables, measured, item, result)
            if recording is not None:
                exact = item.exact.T_map_camera if item.exact else None
                recording.log_frame(item.image, result, exact, measured_xy)
            bar.update()
    return tally


def _write(
    tables: TableWriter, measured: MeasuredTruth, item: DetectedImage, result: FrameResult
) -> tuple[float, float] | None:
    """Adds a frame to the tables; returns the measured x and y where there are any."""
    tables.add(result)
    if item.exact is not None:
        tables.add_truth(
            exact_row(result.frame_index, result.timestamp_ns, item.exact.T_map_camera)
        )
    rows = list(measured.at(result.frame_index, result.timestamp_ns))
    for row in rows:
        tables.add_truth(row)
    return rows[0].position_m[:2] if rows else None


def _says_nothing(inputs: Inputs, folder: Path) -> bool:
    """There is a timed truth, and not one frame that it speaks of."""
    truth = inputs.truth
    if truth is None or not (truth.poses or truth.trajectory):
        return False
    return not measured_rows(folder)


def _check_models(settings: PipelineSettings) -> None:
    """A model of someone's own is settings without a call where its class is not defined."""
    for name, tracker in settings.trackers.items():
        if isinstance(tracker.variance, UnknownVariance):
            raise InputError(
                "settings",
                f"expected a built-in kind, found the custom model {tracker.variance.name}, "
                "which only the program that defines it can replay",
                f"trackers.{name}.variance",
            )


def _check_images(reader: LogReader, inputs: Inputs) -> None:
    """There are images, and the first is of the calibration's size."""
    first = next((r for r in reader.records() if isinstance(r, LogImage)), None)
    if first is None:
        raise InputError(reader.path, "expected images on /camera/image, found none")
    image = decode(first.data)
    if image is not None and image.shape[::-1] != inputs.camera.image_size:
        expected, found = (
            "x".join(map(str, s)) for s in (inputs.camera.image_size, image.shape[::-1])
        )
        raise InputError(
            reader.path,
            f"expected images of {expected} as calibrated, found {found}",
            "/camera/image",
        )


def _span(options: ReplayOptions) -> str:
    start = 0.0 if options.from_s is None else options.from_s
    end = "the end" if options.to_s is None else f"{options.to_s} s"
    return f"the span from {start} s to {end}"


def _cores() -> int:
    """Those that this process may use, where the system tells."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _opencv_threads(count: int | None) -> Iterator[None]:
    """OpenCV with `count` threads of its own; beside ours, more get in the way."""
    before = cv2.getNumThreads()
    if count is not None:
        cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
