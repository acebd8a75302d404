"""The verbs `compare`, `analyze`, `report` and `demo`."""

from __future__ import annotations

from pathlib import Path

import click

from analysis.analyze_cli import analyze
from analysis.report_cli import report


def commands() -> list[click.Command]:
    return [compare, analyze(), report(), demo]


@click.command(
    epilog="""\b
Example:
  arucolog compare logs/sample.results/*
"""
)
@click.argument(
    "results", metavar="RESULT...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option("--json", "as_json", is_flag=True, help="Print the table as JSON.")
def compare(results: tuple[Path, ...], as_json: bool) -> None:
    """Show results of one log side by side: the settings that differ, and the errors."""
    from analysis.compare import as_text
    from analysis.compare import compare as compare_results

    table = compare_results(results)
    click.echo(table.to_json(orient="records", indent=2) if as_json else as_text(table))


@click.command(
    epilog="""\b
Example:
  arucolog demo -o /tmp/arucolog-demo
"""
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("logs/demo"),
    show_default=True,
    help="Folder for what the demo makes; an earlier demo there is replaced.",
)
def demo(output: Path) -> None:
    """Render and record a few seconds, replay the sample log, compare the paper's five models."""
    from analysis.demo import demo as run_demo

    run_demo(output)
