"""From a source into a log and, at the same time, through the pipeline into a result."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.localizer import FrameResult, PipelineSettings
from recorder.attachments import merge_attachments
from recorder.capture.source_thread import is_live
from recorder.errors import InputError
from recorder.interrupts import uninterrupted
from recorder.log.parts import open_log
from recorder.record import RecordSummary, Status, record
from recorder.sources.base import CapturedFrame, LiveSource, Source
from replay.inputs import Inputs, gather_files
from replay.live.gate import Admission, gated
from replay.live.latency import Latency
from replay.live.rrd import complete_rrd
from replay.live.tracking import LiveTracking, Situation
from replay.result import new_result
from replay.result_run import RRD, check_models, not_written_text, write_inputs, write_summary
from replay.stages import cores
from replay.viewer.output import NotWrittenError


@dataclass(frozen=True)
class TrackOptions:
    """How to track and record.

    Attributes:
        rrd: write the Rerun file.
        jobs: threads for decoding and detection (None: one per core); the tables are the same.
        duration_s: stop so long after the first frame.
        min_free_bytes: stop before there is less space on the disk.
        force: replace a log and a result that exist.
    """

    settings: PipelineSettings = field(default_factory=PipelineSettings)
    rrd: bool = True
    jobs: int | None = None
    duration_s: float | None = None
    min_free_bytes: int = 0
    force: bool = False


@dataclass(frozen=True)
class TrackStatus:
    """How it stands; `latency` is that of the last seconds."""

    recording: Status
    situation: Situation
    latency: Latency


@dataclass(frozen=True)
class Tracked:
    """What is left.

    Attributes:
        summary: of the result; None where there is none: the log was not ended well, or tracking
            failed.
        problem: why tracking failed, while the recording went on.
        rrd_problem: why the result, though its tables are complete, has no Rerun file.
    """

    recorded: RecordSummary
    summary: dict[str, Any] | None
    problem: str | None = None
    rrd_problem: str | None = None


class _NoResultError(Exception):
    """The log is not one that a result can be of, or tracking failed."""

    def __init__(self, recorded: RecordSummary, problem: str | None = None) -> None:
        super().__init__()
        self.recorded = recorded
        self.problem = problem


def track(
    source: Source | LiveSource,
    log: Path,
    folder: Path,
    name: str,
    options: TrackOptions,
    *,
    attachments: Mapping[str, bytes] | None = None,
    on_result: Callable[[CapturedFrame, FrameResult], None] | None = None,
    on_status: Callable[[TrackStatus], None] | None = None,
    display_missed: Callable[[], int] | None = None,
) -> Tracked:
    """Records `source` into `log` and tracks every frame that is in it, into the folder `folder`.

    The tables are those of a replay of the log. A live source's frames that come faster than they
    can be tracked are in neither: they are dropped before, and the log's events say so. Of a source
    that waits, nothing is dropped.

    Args:
        attachments: `camera.yaml`, `map.yaml`, `truth.*` in place of those the source brings.
        on_result: called with each frame when it is tracked; must return at once.
        on_status: called ten times a second, from this thread.
        display_missed: frames that `on_result` was given and nobody will see, so far.

    When tracking fails, the recording of a live source goes on.

    Raises:
        InputError: no calibration or map, tracking failed, or as `record`; there is no result then.
    """
    check_models(options.settings)
    files = merge_attachments(source.attachments, attachments or {})
    inputs = gather_files(files, source.name)
    jobs = options.jobs or cores()
    # One in each thread, some waiting for it (a machine that does more has its moments), one being
    # recorded, one being tracked. More would only make what is tracked older.
    admission = Admission(4 * jobs + 2)
    live = is_live(source)
    try:
        with new_result(folder, force=options.force) as temporary:
            started = time.perf_counter()
            tracking = LiveTracking(
                temporary,
                inputs,
                options.settings,
                name=name,
                log_name=log.stem,
                rrd=options.rrd,
                jobs=jobs,
                admission=admission,
                from_capture=live,
                on_result=on_result,
            )

            def tell(status: Status) -> None:
                if on_status is not None:
                    latency = tracking.latencies.recent()
                    on_status(TrackStatus(status, tracking.situation, latency))

            with tracking:
                recorded = record(
                    gated(source, admission),
                    log,
                    attachments=attachments,
                    force=options.force,
                    duration_s=options.duration_s,
                    min_free_bytes=options.min_free_bytes,
                    on_status=tell,
                    on_written=tracking.submit,
                    display_missed=display_missed,
                )
            wall_s = time.perf_counter() - started
            if isinstance(tracking.error, OSError):
                raise _NoResultError(recorded, f"{folder}: {not_written_text(tracking.error)}")
            if isinstance(tracking.error, InputError):
                raise _NoResultError(recorded, str(tracking.error))
            if tracking.error is not None:
                raise tracking.error
            if not recorded.frames_written or recorded.ended in ("disk_full", "failed"):
                raise _NoResultError(recorded)
            clock = source.describe().get("clock", "") if live else ""
            try:
                with uninterrupted():
                    summary = _finish(
                        temporary, log, inputs, name, options, tracking, recorded, clock, wall_s
                    )
            except OSError as error:
                raise _NoResultError(recorded, f"{folder}: {not_written_text(error)}") from error
    except _NoResultError as none:
        return Tracked(none.recorded, None, none.problem)
    return Tracked(recorded, summary, rrd_problem=tracking.rrd_problem)


def _finish(
    folder: Path,
    log: Path,
    inputs: Inputs,
    name: str,
    options: TrackOptions,
    tracking: LiveTracking,
    recorded: RecordSummary,
    clock: str,
    wall_s: float,
) -> dict[str, Any]:
    write_inputs(folder, inputs, options.settings)
    with open_log([log]) as reader:
        log_sha256 = reader.sha256()
        if options.rrd and tracking.rrd_problem is None:
            try:
                complete_rrd(folder / RRD, name, reader, log_sha256)
            except NotWrittenError as error:
                tracking.rrd_problem = error.reason
        tally = tracking.tally
        if tally.frames != reader.image_count():
            raise InputError(
                log, f"expected {tally.frames} images as tracked, found {reader.image_count()}"
            )
        more: dict[str, Any] = {
            "name": name,
            "log_sha256": log_sha256,
            "overrides": [],
            "from_s": None,
            "to_s": None,
            "ended": recorded.ended,
            "frames_dropped": recorded.frames_dropped,
            "latency_ms": {
                **tracking.latencies.overall().as_dict(),
                "from": "capture" if clock else "hand-over",
                "clock": clock or "system clock",
            },
        }
        return write_summary(folder, reader, inputs, options.settings, tally, wall_s, more)
