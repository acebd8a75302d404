"""The verbs `init`, `record`, `info` and `attach`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from recorder.cameras_cli import camera_options, cameras
from recorder.click_types import FiniteFloat
from recorder.live_option import OpenView, View, with_live
from recorder.map_cli import map_group
from recorder.prints_cli import markers
from recorder.quantities import Duration, Size
from recorder.recover_cli import recover
from recorder.truth_cli import truth_group
from recorder.verify_cli import verify

if TYPE_CHECKING:
    from recorder.capture.parts import SplitLimit
    from recorder.record import Status
    from recorder.sources.live.settings import CameraSettings
    from recorder.sources.opening import SourceOptions

_FILE = click.Path(path_type=Path, dir_okay=False)
_LENGTH = FiniteFloat(above=0.0)
_NO_VIEW = View()


def commands(live: OpenView | None = None) -> list[click.Command]:
    """The verbs; `live`: who shows frames while they are recorded."""
    verb = record if live is None else with_live(record, live)
    return [init, verb, cameras, info, attach, verify, recover, map_group, markers, truth_group]


@click.command(
    epilog="""\b
Example:
  arucolog init hall --rows 4 --cols 6 --pitch-m 0.8 --height-m 2.6
"""
)
@click.argument("folder", metavar="[DIR]", default=".", type=click.Path(path_type=Path))
@click.option(
    "--rows", type=click.IntRange(min=1), default=3, show_default=True, help="Of the grid."
)
@click.option(
    "--cols", type=click.IntRange(min=1), default=4, show_default=True, help="Of the grid."
)
@click.option("--pitch-m", type=_LENGTH, default=1.0, show_default=True, help="Between markers.")
@click.option("--height-m", type=_LENGTH, default=2.5, show_default=True, help="Of the ceiling.")
@click.option(
    "--size-m", type=_LENGTH, default=0.15, show_default=True, help="Of the black square."
)
@click.option("--dictionary", default="DICT_6X6_1000", show_default=True, help="Of cv2.aruco.")
@click.option("--force", is_flag=True, help="Replace files that exist.")
def init(
    folder: Path,
    rows: int,
    cols: int,
    pitch_m: float,
    height_m: float,
    size_m: float,
    dictionary: str,
    force: bool,
) -> None:
    """Write commented camera, map, truth and settings files to start from.

    The map is a grid of markers on a ceiling.
    """
    from recorder.templates import CeilingGrid, write_templates

    try:
        grid = CeilingGrid(rows, cols, pitch_m, height_m, size_m, dictionary)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    for path in write_templates(folder, grid, force=force):
        click.echo(path)


@click.command(
    epilog="""\b
Example:
  arucolog record drive.mp4 --camera camera.yaml --map map.yaml --truth truth.yaml -o drive.mcap
"""
)
@click.argument("source", metavar="SOURCE")
@click.option("-o", "--output", type=_FILE, help="The log [logs/STEM-UTC.mcap].")
@click.option("--camera", type=_FILE, help="The calibration, camera.yaml.")
@click.option("--map", "map_path", type=_FILE, help="Where the markers are, map.yaml.")
@click.option("--truth", type=_FILE, help="The ground truth: truth.yaml, TUM or CSV.")
@click.option(
    "--start",
    metavar="TIME",
    help="Capture time of second 0 of a file: seconds since 1970, or as 2025-06-01T12:00:00Z "
    "[the video's creation time, else 0].",
)
@click.option(
    "--fps", metavar="RATE", help="Images a second in a folder, such as 10 or 30000/1001 [1]."
)
@click.option(
    "--encoding",
    type=click.Choice(["jpeg", "png"]),
    help="Of video that is not MJPEG [jpeg, quality 95], of uncompressed images in a bag [png].",
)
@click.option("--topic", metavar="NAME", help="Of the images, in a ROS bag that has several.")
@click.option(
    "--duration", type=Duration(), metavar="TIME", help="Stop so long after the first frame: 10min."
)
@click.option(
    "--split",
    metavar="SIZE|TIME",
    help="Parts LOG-001, LOG-002, ... of 1GB or 10min; replay takes them as one log.",
)
@click.option(
    "--min-free",
    type=Size(),
    default="200MB",
    show_default=True,
    help="Stop before less of the disk is free.",
)
@click.option("--force", is_flag=True, help="Replace a log that exists.")
@click.option("--no-keys", is_flag=True, help="Read no keys that mark waypoints.")
@camera_options
def record(
    source: str,
    output: Path | None,
    camera: Path | None,
    map_path: Path | None,
    truth: Path | None,
    start: str | None,
    fps: str | None,
    encoding: Literal["jpeg", "png"] | None,
    topic: str | None,
    duration: float | None,
    split: str | None,
    min_free: int,
    force: bool,
    no_keys: bool,
    camera_settings: CameraSettings,
    live: View = _NO_VIEW,
) -> None:
    """Record SOURCE into a log.

    SOURCE is a camera (/dev/video0, an RTSP or HTTP MJPEG URL), a video, a folder of images, a ROS
    bag, a scene.yaml or a shipped scene.

    Calibration, map and truth go into the log as they are. Ctrl-C ends a recording; what is there
    stays. A camera without --duration is recorded until then (exit code 0; else 130). Frames that
    were dropped, late or corrupt are counted, on screen and in the log.

    While a live camera records in a terminal, keys mark waypoints: `3 Enter` arrived at 3, n the
    next, s stands still there until s is pressed again, u undoes, t takes a note, ? helps. With
    the waypoints' places in truth.yaml the marks are timed poses.
    """
    from recorder.attachments import named_as_given, read_attachments
    from recorder.bench.session import keys_remark, waypoint_keys
    from recorder.capture.source_thread import is_live
    from recorder.files.output_file import LOG, check_suffix
    from recorder.record import record as record_log
    from recorder.record_progress import RecordProgress
    from recorder.record_text import ending_text, exit_code, status_text, summary_text
    from recorder.sources.opening import open_source

    check_suffix(output, LOG)
    options = source_options(start, fps, encoding, topic, camera_settings)
    attachments = read_attachments(camera, map_path, truth)
    opened = open_source(source, options)
    if preparation := opened.preparation():
        click.echo(preparation, err=True)
    if not no_keys and (remark := keys_remark(opened, attachments)):
        click.echo(remark, err=True)
    with (
        named_as_given(camera, map_path, truth),
        log_path(output, opened.name) as path,
        live.sinks(opened, attachments) as sinks,
        RecordProgress("record", opened.frame_count()) as progress,
        waypoint_keys(opened, attachments, wanted=not no_keys) as bench,
    ):

        def show(status: Status) -> None:
            progress.show(status.counts.written, status_text(status), status.told)
            bench.refresh()

        summary = record_log(
            bench.source,
            path,
            attachments=attachments,
            force=force,
            duration_s=duration,
            split=_split_limit(split),
            min_free_bytes=min_free,
            notes=bench.notes,
            sinks=sinks,
            on_status=show,
        )
    click.echo(summary_text(summary))
    endless = is_live(opened) and duration is None
    if ending := ending_text(summary, endless=endless):
        click.echo(ending, err=True)
    click.get_current_context().exit(exit_code(summary, endless=endless))


@click.command(
    epilog="""\b
Example:
  arucolog info logs/sample.mcap --json
"""
)
@click.argument("log", type=_FILE)
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def info(log: Path, as_json: bool) -> None:
    """Say what is in a log: frames, rate, gaps, calibration, map, truth, events, how it ended."""
    import json

    from recorder.info import log_info
    from recorder.info_text import info_text

    found = log_info(log)
    click.echo(json.dumps(found.as_dict(), indent=2) if as_json else info_text(found))


@click.command(
    epilog="""\b
Example:
  arucolog attach drive.mcap --truth measured-later.yaml -o drive-with-truth.mcap
"""
)
@click.argument("log", type=_FILE)
@click.option("--truth", type=_FILE, help="The ground truth: truth.yaml, TUM or CSV.")
@click.option("--camera", type=_FILE, help="The calibration, camera.yaml.")
@click.option("--map", "map_path", type=_FILE, help="Where the markers are, map.yaml.")
@click.option("-o", "--output", type=_FILE, required=True, help="The copy.")
@click.option("--force", is_flag=True, help="Replace a log that exists, also LOG itself.")
def attach(
    log: Path,
    truth: Path | None,
    camera: Path | None,
    map_path: Path | None,
    output: Path,
    force: bool,
) -> None:
    """Copy a log with other truth, calibration or map in it; images and times stay as they are."""
    from recorder.attach import attach as attach_files
    from recorder.attachments import named_as_given, read_attachments
    from recorder.files.output_file import LOG, check_suffix

    check_suffix(output, LOG)
    attachments = read_attachments(camera, map_path, truth)
    if not attachments:
        raise click.UsageError("expected --truth, --camera or --map")
    with named_as_given(camera, map_path, truth):
        attach_files(log, output, attachments, force=force)
    click.echo(f"{output}: {', '.join(attachments)} attached")


def source_options(
    start: str | None,
    fps: str | None,
    encoding: Literal["jpeg", "png"] | None,
    topic: str | None,
    camera: CameraSettings,
) -> SourceOptions:
    from recorder.sources.live.settings import parse_rate
    from recorder.sources.opening import SourceOptions, parse_start

    try:
        rate = None if fps is None else parse_rate(fps)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--fps") from error
    try:
        start_ns = None if start is None else parse_start(start)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--start") from error
    return SourceOptions(start_ns, rate, encoding, topic, camera)


def _split_limit(text: str | None) -> SplitLimit | None:
    from recorder.capture.parts import SplitLimit

    try:
        return None if text is None else SplitLimit.parse(text)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--split") from error


@contextmanager
def log_path(output: Path | None, stem: str) -> Iterator[Path]:
    """The log to write; a folder `logs` that was made for it goes again if nothing came of it."""
    if output is not None:
        yield output
        return
    from datetime import UTC, datetime

    folder = Path("logs")
    made = not folder.exists()
    folder.mkdir(exist_ok=True)
    try:
        yield folder / f"{stem}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.mcap"
    finally:
        if made:
            with suppress(OSError):
                folder.rmdir()
