"""The main job in a minute: render, record, replay, compare."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click
from tqdm import tqdm

from analysis.compare import as_text, compare
from recorder.errors import InputError
from recorder.record import record
from recorder.sources.base import CapturedFrame
from recorder.sources.opening import open_source
from replay.run import ReplayOptions, replay
from replay.settings_file import load_settings

SAMPLE = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"
SAMPLE_SETTINGS = SAMPLE.with_name("sample.settings.yaml")

RENDERED_SCENE = "hard"


def demo(output: Path) -> None:
    """Renders and records a scene, replays it and the sample log, prints what to look at.

    Args:
        output: folder for the log and the results; those of an earlier demo are replaced.

    Raises:
        InputError: the sample log is not beside the code.
    """
    for path in (SAMPLE, SAMPLE_SETTINGS):
        if not path.exists():
            raise InputError(path, "expected the sample of a source checkout, found none")
    output.mkdir(parents=True, exist_ok=True)

    click.echo(f"1. Rendering and recording the scene `{RENDERED_SCENE}`")
    started = time.perf_counter()
    log = output / f"{RENDERED_SCENE}.mcap"
    source = open_source(RENDERED_SCENE)
    if preparation := source.preparation():
        click.echo(f"   {preparation}")
    with tqdm(total=source.frame_count(), unit="frame", desc="   record", disable=None) as bar:

        def count(_: CapturedFrame) -> None:
            bar.update()

        recorded = record(source, log, force=True, sinks=[count])
    if recorded.ended == "interrupted":
        raise KeyboardInterrupt
    if recorded.ended != "complete":
        raise InputError(log, "expected space for the recording, found a full disk")
    seconds = time.perf_counter() - started
    click.echo(f"   {log}: {recorded.frames_written} frames in {seconds:.1f} s")
    result = output / RENDERED_SCENE
    summary = replay(log, result, RENDERED_SCENE, ReplayOptions(force=True))
    found = summary["status"].get("ok", 0)
    click.echo(f"   {result}: {found} of {summary['frames']} frames with a pose")

    click.echo(f"2. Replaying {_short(SAMPLE)} with {_short(SAMPLE_SETTINGS)}")
    result = output / "sample"
    options = ReplayOptions(settings=load_settings(SAMPLE_SETTINGS), force=True)
    summary = replay(SAMPLE, result, "sample", options)
    click.echo(
        f"   {summary['frames']} frames, {summary['frames_per_second']:.0f} frames/s. "
        "One marker is used on the first side, then three, five and all."
    )

    click.echo("3. The five variance models side by side\n")
    click.echo(as_text(compare([result])))
    click.echo(f"\nLook at it: {_short(Path(sys.argv[0]))} view {result}\n{result / 'replay.rrd'}")


def _short(path: Path) -> Path:
    """Relative to the current folder where that is shorter."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
