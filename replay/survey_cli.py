"""The verb `map survey`."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.click_types import FiniteFloat

_FILE = click.Path(path_type=Path, dir_okay=False)
_SECONDS = FiniteFloat()
_ABOVE_ZERO = FiniteFloat(above=0.0)


class _Ids(click.ParamType[frozenset[int]]):
    """Marker ids as `0,5` or `0-3,7`."""

    name = "ids"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> frozenset[int]:
        from recorder.marker_ids import parse_ids

        if isinstance(value, frozenset):
            return value
        try:
            return frozenset(parse_ids(str(value)))
        except ValueError as error:
            self.fail(str(error), param, ctx)


@click.command(
    epilog="""\b
Example:
  arucolog map survey drive.mcap --map rough.yaml --fix 0,11 -o refined.yaml
"""
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=_FILE)
@click.option("--map", "map_path", type=_FILE, help="The hand-measured map [the log's].")
@click.option("--camera", type=_FILE, help="Calibration in place of the log's.")
@click.option(
    "--fix",
    multiple=True,
    type=_Ids(),
    metavar="ID,ID",
    help="Markers held exactly where they are; two or more that are far apart are best [none: the "
    "map as a whole stays where the hand measurements have it on average].",
)
@click.option(
    "--std-m",
    type=_ABOVE_ZERO,
    default=0.01,
    show_default=True,
    help="Uncertainty of a measured x, y or z, where the map gives no std_m.",
)
@click.option(
    "--std-deg",
    type=_ABOVE_ZERO,
    default=1.0,
    show_default=True,
    help="Uncertainty of a measured yaw or tilt.",
)
@click.option(
    "--loss",
    type=click.Choice(["soft_l1", "huber", "cauchy", "linear"]),
    default="soft_l1",
    show_default=True,
    help="How little a corner counts that is far off.",
)
@click.option(
    "--max-frames",
    type=click.IntRange(min=2),
    default=400,
    show_default=True,
    help="Of a longer log, so many that differ are used.",
)
@click.option(
    "--every", type=click.IntRange(min=1), default=1, help="Look at each so many-th image only."
)
@click.option("--from", "from_s", type=_SECONDS, metavar="S", help="From this second of the log.")
@click.option("--to", "to_s", type=_SECONDS, metavar="S", help="To this second of the log.")
@click.option("--settings", "settings_path", type=_FILE, help="For detector and start poses.")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting; may be repeated.",
)
@click.option("-o", "--output", type=_FILE, help="The refined map.yaml [only the report].")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
@click.option("--jobs", type=click.IntRange(min=1), help="Threads [one per core].")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def survey(
    logs: tuple[Path, ...],
    map_path: Path | None,
    camera: Path | None,
    fix: tuple[frozenset[int], ...],
    std_m: float,
    std_deg: float,
    loss: str,
    max_frames: int,
    every: int,
    from_s: float | None,
    to_s: float | None,
    settings_path: Path | None,
    overrides: tuple[str, ...],
    output: Path | None,
    force: bool,
    jobs: int | None,
    as_json: bool,
) -> None:
    """Refine hand-measured marker poses from a recorded drive.

    A bundle adjustment: every marker and every frame's camera pose are moved until the corners fit
    best, with each hand measurement as one more observation. Only frames that see two mapped
    markers say something; drive so that each marker is seen with several others, from all sides.
    The camera's calibration is taken as exact. By how much the detector puts edges inside the true
    ones is found from the log itself. Several LOGs of one camera are taken together.
    """
    if from_s is not None and to_s is not None and to_s <= from_s:
        raise click.UsageError(f"expected --to after --from, found {to_s} after {from_s}")

    import json

    from recorder.files.output_file import YAML, check_free, check_suffix, write_output
    from replay.settings_file import load_settings
    from replay.survey.logs import survey_logs
    from replay.survey.report import refined_yaml, survey_json, survey_text, warnings
    from replay.survey.results import SurveyOptions
    from replay.survey.sightings import Span

    check_suffix(output, YAML)
    if output is not None:
        check_free(output, force=force)
    done = survey_logs(
        logs,
        camera,
        map_path,
        load_settings(settings_path, overrides),
        SurveyOptions(frozenset().union(*fix), std_m, std_deg, loss, max_frames),  # type: ignore[arg-type]
        Span(from_s, to_s, every, jobs),
        on_step=lambda step: click.echo(step, err=True),
    )
    if output is not None:
        write_output(output, refined_yaml(done.survey, done.sources), force=force)
    if as_json:
        click.echo(json.dumps(survey_json(done.survey, done.count, done.sources), indent=2))
    else:
        click.echo(survey_text(done.survey, done.count))
        if output is not None:
            click.echo(f"{output}: the refined map")
    cut = [f"{name}: {shortfall}" for name, shortfall in done.cut_short.items()]
    for warning in (*cut, *warnings(done.survey)):
        click.echo(f"Warning: {warning}", err=True)
