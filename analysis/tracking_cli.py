"""The verb `analyze tracking`."""

from __future__ import annotations

from pathlib import Path

import click


def tracking() -> click.Command:
    return _tracking


@click.command(
    "tracking",
    epilog="""\b
Example:
  arucolog analyze tracking logs/sample.results/* -o logs/sample.tracking
""",
)
@click.argument(
    "results", metavar="RESULT...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the tables (CSV, LaTeX) and figures (SVG, PNG); files of a study there are "
    "replaced.",
)
@click.option("--json", "as_json", is_flag=True, help="Print tables and findings as JSON.")
def _tracking(results: tuple[Path, ...], output: Path | None, as_json: bool) -> None:
    """Study drives: the trackers' errors, smoothness and consistency, whole and by side.

    Errors are against the exact truth and the hand-measured path, as far as the log has them. The
    sides are those of the path; a filter whose normalized innovations are larger than a chi-square
    allows is overconfident there.
    """
    import json

    from analysis.study import as_json as json_of
    from analysis.study import text, write_study
    from analysis.tracking.study import study_tracking
    from replay.result import open_result

    study = study_tracking([open_result(folder) for folder in results])
    click.echo(json.dumps(json_of(study), indent=2) if as_json else text(study))
    if output is not None:
        paths = write_study(study, output)
        click.echo(f"{output}: {len(paths)} files", err=True)
