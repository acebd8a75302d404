"""The verb `analyze`: the paper's studies, of one's own logs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analysis.study_cli import Command, json_option, show, study_options
from analysis.tracking_cli import tracking
from recorder.click_types import FiniteFloat

if TYPE_CHECKING:
    from analysis.static.subsets import SolverName, SubsetOptions

_RESULT = click.Path(path_type=Path)


def analyze() -> click.Group:
    return _analyze


@click.group(
    "analyze",
    epilog="""\b
Example:
  arucolog analyze tracking logs/sample.results/* -o logs/sample.tracking
""",
)
def _analyze() -> None:
    """Study a log's results: marker placement, number of markers, variances, tracking."""


_analyze.add_command(tracking())


def _subset_options(sample: int | None, frames: int) -> Callable[[Command], Command]:
    """--max, --solver, --sample, --frames and --seed, with the defaults of a study."""

    def decorate(function: Command) -> Command:
        for option in reversed(
            (
                click.option(
                    "--max",
                    "max_markers",
                    type=click.IntRange(min=1),
                    default=7,
                    show_default=True,
                    help="Subsets of one to this many markers.",
                ),
                click.option(
                    "--solver",
                    type=click.Choice(["batch", "opencv"]),
                    default="batch",
                    show_default=True,
                    help="Compiled, or the plain loop over OpenCV: the same cost, slower.",
                ),
                click.option(
                    "--sample",
                    type=click.IntRange(min=1),
                    default=sample,
                    show_default=True if sample else "every subset",
                    help="At most so many random subsets of each size.",
                ),
                click.option(
                    "--frames",
                    type=click.IntRange(min=1),
                    default=frames,
                    show_default=True,
                    help="How many frames: the first of those with the most markers.",
                ),
                click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True),
            )
        ):
            function = option(function)
        return function

    return decorate


@_analyze.command(
    epilog="""\b
Example:
  arucolog analyze placement low.results/* high.results/* -o placement
"""
)
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, type=_RESULT)
@click.option(
    "--large-cm",
    type=FiniteFloat(above=0.0),
    default=20.0,
    show_default=True,
    help="Errors above count as large.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the bootstrap."
)
@study_options
def placement(
    results: tuple[Path, ...], large_cm: float, seed: int, output: Path | None, as_json: bool
) -> None:
    """Study single markers, and pairs, under a camera that stands still.

    Every marker alone: RMSE, mean error, standard deviation, maximum and 95 % quantile in x, y and
    yaw, by ring (tags inner, outer; else by distance from the image centre), rotation class (tags
    rot90, rot45, …) and any other tag of the map. Results at several heights go side by side.
    """
    from analysis.static.placement import PlacementOptions
    from analysis.static.placement import placement as study_placement
    from analysis.static.statistics import Bootstrap

    options = PlacementOptions(Bootstrap(seed=seed), large_cm)
    show(study_placement(results, options), output, as_json=as_json)


@_analyze.command(
    epilog="""\b
Example:
  arucolog analyze count high.results/* --max 7 -o count
"""
)
@click.argument("result", metavar="RESULT", type=_RESULT)
@_subset_options(sample=None, frames=1)
@study_options
def count(
    result: Path,
    max_markers: int,
    solver: SolverName,
    sample: int | None,
    frames: int,
    seed: int,
    output: Path | None,
    as_json: bool,
) -> None:
    """Study every subset of one to seven of the markers in view.

    With -o what is solved is kept in the folder `subsets` there: a run that was stopped goes on
    where it was. One image by default, as in the paper.
    """
    from analysis.static.count import count as study_count

    options = _options(max_markers, solver, sample, frames, seed, keep=output)
    show(study_count(result, options), output, as_json=as_json)


@_analyze.command(
    epilog="""\b
Example:
  arucolog analyze variance high.results/* -o table.yaml
  arucolog replay d.mcap --set "trackers.a={r_scale: 1, variance: {kind: table, path: table.yaml}}"
"""
)
@click.argument("result", metavar="RESULT", type=_RESULT)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="The table to write; an earlier one is replaced.",
)
@_subset_options(sample=20_000, frames=20)
@json_option
def variance(
    result: Path,
    output: Path,
    max_markers: int,
    solver: SolverName,
    sample: int | None,
    frames: int,
    seed: int,
    as_json: bool,
) -> None:
    """Measure the variances of a position fix by number of markers, into a table for settings.

    About the mean over all subsets and frames of a camera that stands still; no truth is needed.
    A tracker uses the table with `variance: {kind: table, path: table.yaml}` and `r_scale: 1`,
    its robust column with `column: robust_cm2` beside that.
    """
    from analysis.static.variance_table import variance as study_variance
    from recorder.files.output_file import YAML, check_suffix

    check_suffix(output, YAML)
    options = _options(max_markers, solver, sample, frames, seed)
    show(study_variance(result, output, options), as_json=as_json)


def _options(
    max_markers: int,
    solver: SolverName,
    sample: int | None,
    frames: int,
    seed: int,
    keep: Path | None = None,
) -> SubsetOptions:
    from analysis.static.subsets import SubsetOptions

    return SubsetOptions(max_markers, solver, sample, frames, seed, keep)
