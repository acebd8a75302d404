"""What the verbs of all studies have in common: -o, --json, and how a study is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from analysis.study import Study

Command = Callable[..., None]

# Of a ranked list, what a terminal shows.
_RANKS = 3


def json_option(function: Command) -> Command:
    return click.option(
        "--json", "as_json", is_flag=True, help="Print tables and findings as JSON."
    )(function)


def study_options(function: Command) -> Command:
    """-o and --json, as every study takes them that writes a folder."""
    return click.option(
        "-o",
        "--output",
        type=click.Path(path_type=Path, file_okay=False),
        help="Folder for tables (CSV, LaTeX) and figures (SVG, PNG); an earlier study's are "
        "replaced.",
    )(json_option(function))


def show(study: Study, output: Path | None = None, *, as_json: bool) -> None:
    """Prints the study, and writes its files to the folder `output`."""
    import json

    from analysis.study import as_json as json_of
    from analysis.study import text, write_study

    click.echo(json.dumps(json_of(study), indent=2) if as_json else text(_shortened(study)))
    if output is not None:
        files = write_study(study, output)
        click.echo(f"{output}: {len(files)} files", err=True)


def _shortened(study: Study) -> Study:
    """For a terminal: of long ranked lists only the first."""
    from dataclasses import replace

    tables = []
    for table in study.tables:
        if "rank" in table.frame and table.frame["rank"].max() > _RANKS:
            shown = table.frame[table.frame["rank"] <= _RANKS]
            note = f"Ranks above {_RANKS} are in the files (-o) and with --json."
            table = replace(table, frame=shown, notes=(*table.notes, note))
        tables.append(table)
    return replace(study, tables=tuple(tables))
