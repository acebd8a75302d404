"""Measured variances by number of markers, as a file that settings can point to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from analysis.static.subsets import (
    Selection,
    SubsetOptions,
    select_frames,
    solve_sizes,
)
from analysis.static.variance_figure import variance_figure
from analysis.static.variance_measure import (
    DRAWS,
    MIN_FIXES,
    MIN_SUBSETS,
    MeasuredVariance,
    measure,
    usable_rows,
)
from analysis.static.view import StillView, open_view
from analysis.study import Study, StudyTable, write_files
from pipeline.geometry import Array
from recorder.errors import InputError
from replay.versions import versions

DEFAULTS = SubsetOptions(sample=20_000, n_frames=20)

_AXES = ("x", "y")


@dataclass(frozen=True)
class VarianceStudy:
    """The study, and the table.yaml that it makes: its content under a file name."""

    study: Study
    content: Callable[[str], str]


def variance(folder: Path, output: Path, options: SubsetOptions = DEFAULTS) -> Study:
    """Measures a result's variances and writes them to the file `output`.

    Raises:
        InputError: no result, no known marker, or the camera moved; as `study_variance`.
    """
    measured = study_variance(open_view(folder), options)
    write_files(output.parent, {output.name: measured.content(output.name).encode()})
    use = f"r_scale: 1, variance: {{kind: table, path: {output.name}}}"
    written = f"Written to {output}; use it with {use}."
    return replace(measured.study, findings=(*measured.study.findings, written))


def study_variance(view: StillView, options: SubsetOptions = DEFAULTS) -> VarianceStudy:
    """Measures a view's variances.

    Raises:
        InputError: no marker is in all frames, too many subsets, one marker alone has fewer than
            `MIN_FIXES` fixes or no scatter, or fewer than `MIN_SUBSETS` markers are in view.
    """
    chosen = select_frames(view, options.n_frames)
    sizes = range(1, min(options.max_markers, len(chosen.ids)) + 1)
    solved = solve_sizes(view, chosen, sizes, options)
    measured = list(map(partial(measure, seed=options.seed), solved))
    rows = usable_rows(measured)
    if not rows:
        raise InputError(
            view.result.folder,
            f"expected at least {MIN_SUBSETS} markers in view with {MIN_FIXES} different fixes of "
            f"one marker, found {measured[0].subsets} with {measured[0].fixes}; a longer log or "
            "more --frames gives more fixes",
        )
    study = Study(
        "variance",
        "Variances by number of markers",
        (_table(view, chosen, measured, options, len(rows)), _sample_table(measured)),
        (variance_figure(rows),),
        tuple(_findings(measured)),
    )
    return VarianceStudy(
        study, lambda name: table_text(name, rows, _source(view, chosen, measured, options))
    )


def table_text(name: str, rows: Sequence[MeasuredVariance], source: dict[str, Any]) -> str:
    """A table.yaml that is to be called `name`."""
    content = {
        "cm2": [_plain(row.cm2) for row in rows],
        "robust_cm2": [_plain(row.robust_cm2) for row in rows],
        "source": source,
    }
    body: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
    return (
        "# Variances of a position fix in cm² (x, y) with one, two, … markers, about their mean.\n"
        "# In settings.yaml, in a tracker with r_scale: 1 (0.25 is the paper's, for its table):\n"
        f"#   variance: {{kind: table, path: {name}}}\n"
        "# robust_cm2, from the median absolute deviation:  "
        f"{{kind: table, path: {name}, column: robust_cm2}}\n"
    ) + body


def _plain(values: Array) -> list[float]:
    """Six digits: more is not known."""
    return [float(f"{value:.6g}") for value in values]


def _source(
    view: StillView,
    chosen: Selection,
    measured: Sequence[MeasuredVariance],
    options: SubsetOptions,
) -> dict[str, Any]:
    summary = view.result.summary
    return {
        "log": str(summary["log"]),
        "log_sha256": str(summary["log_sha256"]),
        "height_m": float(f"{view.height_m:.4g}"),
        "markers": len(chosen.ids),
        "frames": len(chosen.frames),
        "solver": options.solver,
        "seed": options.seed,
        "subsets": [row.subsets for row in measured],
        "of": [row.of for row in measured],
        "fixes": [row.fixes for row in measured],
        "arucolog": versions()["arucolog"],
    }


def _table(
    view: StillView,
    chosen: Selection,
    measured: Sequence[MeasuredVariance],
    options: SubsetOptions,
    written: int,
) -> StudyTable:
    import pandas as pd

    rows = []
    for row in measured:
        cells: dict[str, Any] = {
            "markers": row.markers,
            "subsets": row.subsets,
            "of": row.of,
            "fixes": row.fixes,
        }
        for i, axis in enumerate(_AXES):
            cells |= {
                f"var_{axis}_cm2": row.cm2[i],
                f"var_{axis}_low_cm2": row.low_cm2[i],
                f"var_{axis}_high_cm2": row.high_cm2[i],
                f"robust_{axis}_cm2": row.robust_cm2[i],
            }
        rows.append(cells)
    notes = [
        chosen.note(view),
        f"Solver: {options.solver}. About the mean over all fixes; no truth is used, so a common "
        "error of all fixes is not in here.",
        "Intervals: 95 %, jackknife over the markers: what other markers in their places would "
        "have given. Robust: (1.4826 MAD)².",
        "Subsets of nearly all markers share most of them: the last rows understate how much "
        "fixes from other markers would scatter."
        if measured[-1].markers > len(chosen.ids) / 2
        else "",
    ]
    if any(row.subsets < row.of for row in measured):
        notes.append(
            f"Where fewer than all subsets are solved they are random, seed {options.seed}."
        )
    if written < len(measured):
        notes.append(
            f"Not in the file: rows from {written + 1} markers on: fewer than {MIN_FIXES} fixes, "
            f"fewer than {MIN_SUBSETS} different subsets, no interval or no scatter."
        )
    return StudyTable(
        "variance",
        "Variance of a position fix about the mean, by number of markers",
        pd.DataFrame(rows),
        tuple(note for note in notes if note),
        digits=4,
    )


def _sample_table(measured: Sequence[MeasuredVariance]) -> StudyTable:
    import pandas as pd

    rows = [
        {
            "markers": row.markers,
            "sample": size,
            **{
                f"{axis}_{end}_pct": 100.0 * ends[i, e]
                for i, axis in enumerate(_AXES)
                for e, end in enumerate(("low", "high"))
            },
        }
        for row in measured
        for size, ends in row.spread.items()
    ]
    columns = ["markers", "sample", "x_low_pct", "x_high_pct", "y_low_pct", "y_high_pct"]
    return StudyTable(
        "variance_sample_size",
        "What a smaller sample of the fixes gives, in percent of the variance of all",
        pd.DataFrame(rows, columns=columns),
        (f"2.5 and 97.5 % of {DRAWS} random samples with replacement.",),
        digits=0,
    )


def _findings(measured: Sequence[MeasuredVariance]) -> list[str]:
    found = []
    heavy = [
        f"{row.markers}: {np.sqrt(row.cm2.sum() / row.robust_cm2.sum()):.1f}"
        for row in measured
        if np.isfinite(row.cm2).all() and row.robust_cm2.sum() > 0
    ]
    if heavy:
        found.append(
            "Standard deviation over the robust one, by number of markers (1: a Gaussian; more: "
            f"outliers): {', '.join(heavy)}."
        )
    return found
