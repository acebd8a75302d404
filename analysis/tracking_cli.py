"""The verb `analyze tracking`."""

from __future__ import annotations

from pathlib import Path

import click

from analysis.study_cli import show, study_options


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
@study_options
def _tracking(results: tuple[Path, ...], output: Path | None, as_json: bool) -> None:
    """Study drives: the trackers' errors, smoothness and consistency, whole and by side.

    Errors are against the exact truth and the hand-measured path, as far as the log has them. The
    sides are those of the path; a filter whose normalized innovations are larger than a chi-square
    allows is overconfident there.
    """
    from analysis.tracking.study import study_tracking
    from replay.result import open_result

    show(study_tracking([open_result(folder) for folder in results]), output, as_json=as_json)
