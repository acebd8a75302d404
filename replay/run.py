"""One log through the pipeline: tables, summary and a Rerun file."""

from __future__ import annotations

import errno
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pipeline.localizer import PipelineSettings
from recorder.errors import InputError
from recorder.image_decoding import decode_gray
from recorder.log.parts import open_log
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent, LogImage
from replay.inputs import Inputs, Overrides, gather
from replay.result import new_result
from replay.result_run import (
    RRD,
    ResultRun,
    check_models,
    not_written_text,
    rrd_problem_text,
    write_inputs,
    write_summary,
)
from replay.stages import cores, detect_ahead, opencv_threads, pair


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


def replay(
    log: Path | Sequence[Path], out: Path, name: str, options: ReplayOptions
) -> dict[str, Any]:
    """Replays `log`, or the parts of one, into the folder `out` and returns its summary.

    Raises:
        InputError: the log, a file or the output is not what it should be; nothing is left behind.
            Where it is only the Rerun file that cannot be written, the rest of the result is.
    """
    check_models(options.settings)
    paths = (log,) if isinstance(log, Path) else tuple(log)
    try:
        with open_log(paths) as reader, new_result(out, force=options.force) as folder:
            inputs = gather(reader, options.overrides)
            _check_images(reader, inputs)
            write_inputs(folder, inputs, options.settings)
            log_sha256 = reader.sha256()
            started = time.perf_counter()
            run = _run(reader, inputs, folder, name, log_sha256, options)
            tally = run.tally
            wall_s = time.perf_counter() - started
            if not tally.frames:
                raise InputError(reader.path, f"expected images in {_span(options)}, found none")
            given = vars(options.overrides).items()
            more = {
                "name": name,
                "log_sha256": log_sha256,
                "overrides": sorted(key for key, value in given if value is not None),
                "from_s": options.from_s,
                "to_s": options.to_s,
            }
            summary = write_summary(folder, reader, inputs, options.settings, tally, wall_s, more)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InputError(out, not_written_text(error)) from error
    if run.rrd_problem is not None:
        raise InputError(out / RRD, rrd_problem_text(run.rrd_problem))
    return summary


def _run(
    reader: LogReader,
    inputs: Inputs,
    folder: Path,
    name: str,
    log_sha256: str,
    options: ReplayOptions,
) -> ResultRun:
    settings = options.settings
    jobs = options.jobs or cores()
    run = ResultRun(
        folder,
        inputs,
        settings,
        reader.start_ns or 0,
        name=name,
        log_name=reader.path.stem,
        recording_id=log_sha256 if options.rrd else None,
    )
    with (
        run,
        opencv_threads(1 if jobs > 1 else None),
        tqdm(
            total=None if options.from_s or options.to_s else reader.image_count(),
            unit="frame",
            desc=reader.path.name,
            disable=None if options.progress else True,
            file=sys.stderr,
        ) as bar,
    ):
        records = pair(reader.records(options.from_s, options.to_s))
        for item in detect_ahead(
            records, inputs.camera, lambda: settings.detector.build(inputs.marker_map), jobs
        ):
            if isinstance(item, LogEvent):
                run.event(item)
                continue
            run.keep(item, run.localize(item))
            bar.update()
    return run


def _check_images(reader: LogReader, inputs: Inputs) -> None:
    """There are images, and the first is of the calibration's size."""
    first = next((r for r in reader.records() if isinstance(r, LogImage)), None)
    if first is None:
        raise InputError(reader.path, "expected images on /camera/image, found none")
    image = decode_gray(first.data)
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
