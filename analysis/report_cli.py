"""The verb `report`."""

from __future__ import annotations

from pathlib import Path

import click


def report() -> click.Command:
    return _report


@click.command(
    "report",
    epilog="""\b
Example:
  arucolog report logs/sample.results/* -o logs/sample.html
""",
)
@click.argument(
    "results", metavar="RESULT...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("report.html"),
    show_default=True,
    help="The page; tables (CSV, LaTeX) and figures go into a folder beside it.",
)
@click.option("--title", help="Of the page [the logs' names].")
@click.option(
    "--sample",
    type=click.IntRange(min=1),
    help="At most so many random subsets of markers of each size [every one].",
)
@click.option("--force", is_flag=True, help="Replace a report that exists.")
def _report(
    results: tuple[Path, ...], output: Path, title: str | None, sample: int | None, force: bool
) -> None:
    """Write one HTML page with every study that the results allow.

    Still cameras get the studies of placement, number of markers and variances, drives that of
    tracking. The page needs no network; its figures are inside.
    """
    from analysis.report.build import report as build
    from recorder.errors import InputError
    from recorder.files.output_file import HTML, check_suffix

    check_suffix(output, HTML)
    for path in (output, output.with_name(f"{output.stem}_files")):
        if path.exists() and not force:
            raise InputError(path, "already exists; --force replaces it")
    written = build(
        results,
        output,
        title=title,
        sample=sample,
        tick=lambda name: click.echo(f"Studying: {name}", err=True),
    )
    for sentence in written.without:
        click.echo(f"Without a study: {sentence}", err=True)
    click.echo(f"{written.page}\n{written.files}")
