"""The verbs `replay` and `view`, and those of other modules."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.click_types import FiniteFloat
from recorder.map_cli import map_group
from replay.calibrate_cli import calibrate
from replay.export_cli import export
from replay.survey_cli import survey
from replay.track_cli import track

_FILE = click.Path(path_type=Path, dir_okay=False)
_SECONDS = FiniteFloat()


def commands() -> list[click.Command]:
    map_group.add_command(survey)
    return [replay, track(), view, export(), calibrate()]


@click.command(
    epilog="""\b
Example:
  arucolog replay logs/sample.mcap --set pose.max_markers=3 --name three
"""
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=_FILE)
@click.option("--settings", "settings_path", type=_FILE, help="A settings.yaml [the paper's].")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting; may be repeated.",
)
@click.option("--truth", type=_FILE, help="Truth (YAML, TUM or CSV) in place of the log's.")
@click.option("--camera", type=_FILE, help="Calibration in place of the log's.")
@click.option("--map", "map_path", type=_FILE, help="Marker map in place of the log's.")
@click.option("--from", "from_s", type=_SECONDS, metavar="S", help="From this second of the log.")
@click.option("--to", "to_s", type=_SECONDS, metavar="S", help="To this second of the log.")
@click.option("--no-rrd", is_flag=True, help="Tables only, nothing for the viewer.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Result folder; DIR/LOGSTEM for several logs [LOG.results/NAME].",
)
@click.option("--name", help="Name of the result [DIR's, or settings' stem and digest].")
@click.option("--force", is_flag=True, help="Replace a result that exists.")
@click.option("--jobs", type=click.IntRange(min=1), help="Threads [one per core].")
@click.option("--json", "as_json", is_flag=True, help="Print the summaries as JSON.")
def replay(
    logs: tuple[Path, ...],
    settings_path: Path | None,
    overrides: tuple[str, ...],
    truth: Path | None,
    camera: Path | None,
    map_path: Path | None,
    from_s: float | None,
    to_s: float | None,
    no_rrd: bool,
    output: Path | None,
    name: str | None,
    force: bool,
    jobs: int | None,
    as_json: bool,
) -> None:
    """Run recorded logs through detection, pose and tracking.

    Leaves a folder for each log: tables (parquet), summary.json, the settings as they were
    resolved, and replay.rrd for the viewer. The same log and settings give the same tables. Parts
    of one recording, given together in any order, are one log.
    """
    import json

    from recorder.log.parts import group_parts, whole_path
    from replay.inputs import Overrides
    from replay.naming import result_folders, result_name
    from replay.report import summary_text, warnings
    from replay.result import check_free
    from replay.run import ReplayOptions
    from replay.run import replay as replay_log
    from replay.settings_file import load_settings

    if from_s is not None and to_s is not None and to_s <= from_s:
        raise click.UsageError(f"expected --to after --from, found {to_s} after {from_s}")
    options = ReplayOptions(
        settings=load_settings(settings_path, overrides),
        overrides=Overrides(camera, map_path, truth),
        from_s=from_s,
        to_s=to_s,
        rrd=not no_rrd,
        force=force,
        jobs=jobs,
    )
    groups = group_parts(logs, lambda text: click.echo(f"Warning: {text}", err=True))
    if name is None:
        only = output if output is not None and len(groups) == 1 else None
        name = only.resolve().name if only else result_name(settings_path, options)
    summaries = []
    called = [whole_path(group[0]) if len(group) > 1 else group[0] for group in groups]
    pairs = result_folders(called, output, name)
    for _, folder in pairs:
        check_free(folder, force=force)
    for group, (log, folder) in zip(groups, pairs, strict=True):
        summary = replay_log(group, folder, name, options)
        summaries.append({"folder": str(folder), **summary})
        if not as_json:
            click.echo(summary_text(folder, summary))
        for warning in warnings(summary):
            click.echo(f"Warning: {log}: {warning}", err=True)
    if as_json:
        click.echo(json.dumps(summaries, indent=2))


@click.command(
    epilog="""\b
Example:
  arucolog view logs/sample.results/default-*
"""
)
@click.argument(
    "paths", metavar="LOG|RESULT...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option("--save", type=_FILE, help="Write one .rrd file and open no window.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def view(paths: tuple[Path, ...], save: Path | None, force: bool) -> None:
    """Look at a log or at results in the Rerun viewer; several results of a log overlay."""
    from recorder.files.output_file import check_suffix
    from replay.viewer.open import view as open_viewer

    check_suffix(save, [".rrd"])

    def warn(text: str) -> None:
        click.echo(f"Warning: {text}", err=True)

    open_viewer(list(paths), save=save, force=force, warn=warn)
    if save is not None:
        click.echo(save)
