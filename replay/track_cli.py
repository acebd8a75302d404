"""The verb `track`, and what `--live` shows of a recording."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from recorder.cameras_cli import camera_options
from recorder.live_option import live_option, with_option
from recorder.quantities import Duration, Size

if TYPE_CHECKING:
    from recorder.capture.sink_thread import FrameSink
    from recorder.sources.base import Source
    from recorder.sources.live.settings import CameraSettings
    from replay.live.track import Tracked, TrackStatus

_FILE = click.Path(path_type=Path, dir_okay=False)


def open_view(
    address: str, source: Source, attachments: Mapping[str, bytes]
) -> AbstractContextManager[FrameSink]:
    """What shows frames while they are recorded; see `recorder.live_option`."""
    from replay.live.sink import live_sink

    return live_sink(address, source, attachments)


def track() -> click.Command:
    """The verb."""
    return with_option(_track, live_option())


@click.command(
    "track",
    epilog="""\b
Example:
  arucolog track /dev/video0 --camera camera.yaml --map map.yaml --live
""",
)
@click.argument("source", metavar="SOURCE")
@click.option("-o", "--output", type=_FILE, help="The log [logs/STEM-UTC.mcap].")
@click.option(
    "--result",
    "result_path",
    type=click.Path(path_type=Path, file_okay=False),
    help="Result folder [LOG.results/NAME].",
)
@click.option("--name", help="Name of the result [--result's, or settings' stem and digest].")
@click.option("--settings", "settings_path", type=_FILE, help="A settings.yaml [the paper's].")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting; may be repeated.",
)
@click.option("--camera", type=_FILE, help="The calibration, camera.yaml.")
@click.option("--map", "map_path", type=_FILE, help="Where the markers are, map.yaml.")
@click.option("--truth", type=_FILE, help="The ground truth: truth.yaml, TUM or CSV.")
@click.option("--start", metavar="TIME", help="Capture time of second 0 of a file.")
@click.option("--fps", metavar="RATE", help="Images a second in a folder [1].")
@click.option("--encoding", type=click.Choice(["jpeg", "png"]), help="As for `record`.")
@click.option("--topic", metavar="NAME", help="Of the images, in a ROS bag that has several.")
@click.option(
    "--duration", type=Duration(), metavar="TIME", help="Stop so long after the first frame: 10min."
)
@click.option(
    "--min-free",
    type=Size(),
    default="200MB",
    show_default=True,
    help="Stop before less of the disk is free.",
)
@click.option("--no-rrd", is_flag=True, help="Leave no recording for the viewer.")
@click.option("--jobs", type=click.IntRange(min=1), help="Threads [one per core].")
@click.option("--force", is_flag=True, help="Replace a log and a result that exist.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
@camera_options
def _track(
    source: str,
    output: Path | None,
    result_path: Path | None,
    name: str | None,
    settings_path: Path | None,
    overrides: tuple[str, ...],
    camera: Path | None,
    map_path: Path | None,
    truth: Path | None,
    start: str | None,
    fps: str | None,
    encoding: Literal["jpeg", "png"] | None,
    topic: str | None,
    duration: float | None,
    min_free: int,
    no_rrd: bool,
    jobs: int | None,
    force: bool,
    as_json: bool,
    camera_settings: CameraSettings,
    live: str | None,
) -> None:
    """Track SOURCE live, and record it.

    SOURCE is a camera or anything else that `record` takes. The log holds exactly the frames that
    were tracked, the result is that of a replay of the log, made while it was recorded. Frames of a
    camera that come faster than they can be tracked are dropped and counted. Ctrl-C ends it.
    """
    import json

    from recorder.attachments import named_as_given, read_attachments
    from recorder.capture.source_thread import is_live
    from recorder.cli import log_path, source_options
    from recorder.files.output_file import LOG, check_suffix
    from recorder.record_progress import RecordProgress
    from recorder.sources.opening import open_source
    from replay.live.sink import live_view
    from replay.live.track import TrackOptions
    from replay.live.track import track as track_source
    from replay.live.track_text import situation_text, status_text
    from replay.naming import result_folders, result_name
    from replay.result import check_free
    from replay.run import ReplayOptions
    from replay.settings_file import load_settings

    check_suffix(output, LOG)
    settings = load_settings(settings_path, overrides)
    attachments = read_attachments(camera, map_path, truth)
    if name is None:
        same = ReplayOptions(settings=settings)
        name = result_path.resolve().name if result_path else result_name(settings_path, same)
    opened = open_source(source, source_options(start, fps, encoding, topic, camera_settings))
    if preparation := opened.preparation():
        click.echo(preparation, err=True)
    options = TrackOptions(settings, not no_rrd, jobs, duration, min_free, force)
    with ExitStack() as stack:
        stack.enter_context(named_as_given(camera, map_path, truth))
        log = stack.enter_context(log_path(output, opened.name))
        ((_, folder),) = result_folders([log], result_path, name)
        check_free(folder, force=force)
        view = None
        if live is not None:
            view = stack.enter_context(live_view(live, opened, attachments, settings))
        progress = stack.enter_context(RecordProgress("track", opened.frame_count()))

        def missed() -> int:
            # The log of a file is the same whoever watches.
            return view.missed if view is not None and is_live(opened) else 0

        def show(status: TrackStatus) -> None:
            recording = status.recording
            progress.show(
                recording.counts.written,
                status_text(status),
                recording.told,
                situation_text(status.situation),
            )

        tracked = track_source(
            opened,
            log,
            folder,
            name,
            options,
            attachments=attachments,
            on_result=view.offer if view else None,
            on_status=show,
            display_missed=missed,
        )
    if as_json:
        click.echo(json.dumps({"folder": str(folder), **(tracked.summary or {})}, indent=2))
    _say(tracked, folder, as_json=as_json, endless=is_live(opened) and duration is None)


def _say(tracked: Tracked, folder: Path, *, as_json: bool, endless: bool) -> None:
    """What came of it; ends the command with its exit code."""
    from recorder.record_text import ending_text, exit_code
    from recorder.record_text import summary_text as record_text
    from replay.live.track_text import latency_text
    from replay.report import summary_text, warnings
    from replay.result_run import RRD, rrd_problem_text

    recorded, summary = tracked.recorded, tracked.summary
    if not as_json:
        click.echo(record_text(recorded))
    if summary is not None:
        if not as_json:
            click.echo(summary_text(folder, summary))
            click.echo(f"  {latency_text(summary['latency_ms'])}")
        for warning in warnings(summary):
            click.echo(f"Warning: {recorded.path}: {warning}", err=True)
    if ending := ending_text(recorded, endless=endless):
        click.echo(ending, err=True)
    if tracked.problem is not None:
        click.echo(f"Error: tracking failed: {tracked.problem}", err=True)
    if tracked.rrd_problem is not None:
        click.echo(f"Error: {folder / RRD}: {rrd_problem_text(tracked.rrd_problem)}", err=True)
    if summary is None and recorded.frames_written:
        click.echo(f"No result; `arucolog replay {recorded.path}` makes it.", err=True)
    failed = tracked.problem is not None or tracked.rrd_problem is not None
    click.get_current_context().exit(1 if failed else exit_code(recorded, endless=endless))
