"""The study of the number of markers: every subset of one, two, … of the markers in view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.static.alone import AXES
from analysis.static.count_statistics import (
    CLEAR_KNEE,
    EXTREMES,
    QUANTILES,
    CountResult,
    knee,
    summarize,
)
from analysis.static.statistics import MIN_MARKERS
from analysis.static.subsets import SubsetOptions, select_frames, solve_sizes
from analysis.static.view import StillView, open_view
from analysis.study import Study, StudyTable
from pipeline.geometry import Array, wrap_angle
from recorder.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def count(folder: Path, options: SubsetOptions | None = None) -> Study:
    """The study of one result of a camera standing still.

    Raises:
        InputError: no result, no known marker, or the camera moved; as `study_count`.
    """
    return study_count(open_view(folder), options)


def study_count(view: StillView, options: SubsetOptions | None = None) -> Study:
    """The study of one view.

    Raises:
        InputError: no marker is in all frames, too many subsets, or no pose without a truth.
    """
    from analysis.static import count_figures

    options = options or SubsetOptions()
    chosen = select_frames(view, options.n_frames, for_errors=True)
    sizes = list(range(1, min(options.max_markers, len(chosen.ids)) + 1))
    has_truth = all(frame.has_truth for frame in chosen.frames)
    reference = chosen.truth
    if not has_truth:
        whole = next(iter(solve_sizes(view, chosen, [len(chosen.ids)], _quietly(options))))
        if not np.isfinite(whole.values).any():
            raise InputError(
                view.result.folder, "expected a pose from all markers together, found none"
            )
        reference = np.broadcast_to(_mean_pose(whole.values), chosen.truth.shape)
    # Not in a loop of its own, whose variable would keep a size's fixes while the next is solved.
    summary = partial(summarize, view, reference=reference, has_truth=has_truth)
    results = list(map(summary, solve_sizes(view, chosen, sizes, options)))
    notes = (
        chosen.note(view),
        f"Solver: {options.solver}. {_sampling(results, options)}",
        *_shortfalls(results, options.max_markers, len(chosen.ids)),
        (
            f"Errors are against the {view.truth_kind} truth."
            if has_truth
            else "No truth: RMSE and mean error are left out; distances are from the pose of all "
            "markers together."
        ),
    )
    tables = _tables(results, notes, has_truth=has_truth)
    figures = (
        count_figures.violins(results, has_truth=has_truth),
        count_figures.ellipses(results, has_truth=has_truth),
        count_figures.largest(results, has_truth=has_truth),
    )
    return Study(
        "count", "Number of markers", tables, figures, tuple(_findings(results, has_truth))
    )


def _tables(
    results: Sequence[CountResult], notes: tuple[str, ...], *, has_truth: bool
) -> tuple[StudyTable, ...]:
    import pandas as pd

    whole = pd.DataFrame([result.row for result in results])
    head = ["markers", "subsets", "of", "fixes", "failed"]
    axes = [(axis, unit) for axis, _, unit, _ in AXES]
    wide = [*axes, ("position", "cm")]
    what = "error" if has_truth else "distance from the pose of all markers"
    tables = []
    if has_truth:
        columns = [f"{s}_{axis}_{unit}" for s in ("rmse", "bias") for axis, unit in axes]
        tables.append(
            StudyTable(
                "count", "RMSE and mean error by number of markers", whole[[*head, *columns]], notes
            )
        )
        notes = ()
        tables += _interval_tables(whole)
    columns = [f"max_{axis}_{unit}" for axis, unit in wide]
    tables.append(
        StudyTable(
            "count_max", f"Largest {what} by number of markers", whole[[*head[:4], *columns]], notes
        )
    )
    columns = [f"q{q}_{axis}_{unit}" for axis, unit in wide for q in QUANTILES]
    tables.append(
        StudyTable(
            "count_quantiles",
            f"Quantiles (50, 95, 99 %) of the {what}'s magnitude by number of markers",
            whole[["markers", *columns]],
        )
    )
    columns = [f"var_{axis}_{unit}2" for axis, unit in axes]
    tables.append(
        StudyTable(
            "count_variance",
            "Variance about the mean by number of markers",
            whole[["markers", *columns]],
            digits=4,
        )
    )
    tables.append(
        StudyTable(
            "count_extremes",
            f"The {EXTREMES} worst and best subsets by number of markers",
            pd.concat([result.extremes for result in results], ignore_index=True),
            (
                "Marker ids; cm: root mean square over the frames of the horizontal position "
                f"{what}; extent: largest distance between two of the markers.",
            ),
        )
    )
    return tuple(tables)


def _interval_tables(whole: pd.DataFrame) -> list[StudyTable]:
    """RMSE and mean error with their intervals."""
    notes: tuple[str, ...] = (
        "Intervals: 95 %, jackknife over the markers: what other markers in their places would "
        "have given.",
    )
    empty = whole.loc[whole["rmse_x_cm"].notna() & whole["rmse_x_low_cm"].isna(), "markers"]
    if len(empty):
        listed = ", ".join(str(markers) for markers in empty)
        notes += (
            f"No interval for subsets of {listed} markers: fewer than {MIN_MARKERS} are in view, "
            "or subsets of more than half of them share too many.",
        )
    return [
        StudyTable(
            f"count_{statistic}",
            f"{title} by number of markers, with its interval",
            whole[
                [
                    "markers",
                    *(
                        f"{statistic}_{axis}{end}_{unit}"
                        for axis, _, unit, _ in AXES
                        for end in ("", "_low", "_high")
                    ),
                ]
            ],
            notes,
        )
        for statistic, title in (("rmse", "RMSE"), ("bias", "Mean error"))
    ]


def _sampling(results: Sequence[CountResult], options: SubsetOptions) -> str:
    sampled = [r for r in results if r.row["subsets"] < r.row["of"]]
    if not sampled:
        return "Every subset."
    listed = ", ".join(
        f"{_spaced(r.row['subsets'])} of {_spaced(r.row['of'])} with {r.markers} markers"
        for r in sampled
    )
    return f"Random subsets (seed {options.seed}): {listed}; otherwise every subset."


def _spaced(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def _shortfalls(results: Sequence[CountResult], asked: int, in_view: int) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    if asked > in_view:
        notes += (f"No rows above {in_view} markers: more are not in view.",)
    failed = [r for r in results if r.row["failed"]]
    if failed:
        listed = ", ".join(f"{r.row['failed']} of {r.markers}" for r in failed)
        notes += (f"Failed: subsets without a finite pose, in no statistic ({listed} markers).",)
    unsettled = [r for r in results if r.row["unsettled"]]
    if unsettled:
        listed = ", ".join(f"{r.row['unsettled']} of {r.markers}" for r in unsettled)
        notes += (f"Not converged by the solver's own account, yet counted: {listed} markers.",)
    single = [str(r.markers) for r in results if r.row["fixes"] < 2]
    if single:
        notes += (f"No variance from fewer than two fixes: {', '.join(single)} markers.",)
    return notes


def _mean_pose(values: Array) -> Array:
    """(3,) mean x, y and circular mean yaw of the finite fixes."""
    known = values[np.isfinite(values).all(axis=-1)]
    yaw = np.arctan2(np.sin(known[:, 2]).mean(), np.cos(known[:, 2]).mean())
    return np.array([*known[:, :2].mean(axis=0), float(wrap_angle(yaw))])


def _quietly(options: SubsetOptions) -> SubsetOptions:
    return replace(options, progress=False)


def _rises(markers: Sequence[int], cm: Sequence[float]) -> str:
    """Where a value is larger than with one marker less."""
    return ", ".join(
        f"{n} ({before:.2f} to {after:.2f} cm)"
        for n, before, after in zip(markers[1:], cm[:-1], cm[1:], strict=False)
        if after > before
    )


def _findings(results: Sequence[CountResult], has_truth: bool) -> list[str]:
    what = "error" if has_truth else "distance"
    found = []
    by_count = {r.markers: r.row for r in results if r.row["fixes"]}
    markers = list(by_count)
    largest = [by_count[n]["max_position_cm"] for n in markers]
    # A maximum of random subsets is none; what it seems to fall by is the sampling.
    whole = [n for n in markers if by_count[n]["subsets"] == by_count[n]["of"]]
    if len(whole) < len(markers):
        drawn = ", ".join(str(n) for n in markers if n not in whole)
        found.append(f"Of {drawn} markers random subsets were solved: larger {what}s may exist.")
    largest = [by_count[n]["max_position_cm"] for n in whole]
    rmse = [by_count[n]["rmse_position_cm"] for n in markers] if has_truth else []
    at = knee(whole, largest)
    if at is not None:
        falls = (
            f"the largest position {what} falls most from {at.markers - 1} to {at.markers} "
            f"markers, from {at.before:.2f} to {at.after:.2f} cm ({at.factor:.1f} times)"
        )
        found.append(
            f"Knee: {falls}."
            if at.factor >= CLEAR_KNEE
            else f"No clear knee: {falls}, which is less than {CLEAR_KNEE:g} times."
        )
    rises = _rises(whole, largest)
    if rises:
        found.append(f"The largest position {what} rises with one more marker at {rises}.")
    worse = _rises(markers, rmse)
    if worse:
        found.append(f"More markers are worse: the RMSE of the position rises at {worse}.")
    if has_truth and len(markers) > 1:
        listed = ", ".join(f"{n}: {by_count[n]['rmse_position_cm']:.2f}" for n in markers)
        found.append(f"RMSE of the position in cm by number of markers: {listed}.")
        bias = {
            n: float(np.hypot(by_count[n]["bias_x_cm"], by_count[n]["bias_y_cm"])) for n in markers
        }
        listed = ", ".join(f"{n}: {bias[n]:.2f}" for n in markers)
        found.append(f"Size of the mean error in cm by number of markers: {listed}.")
    for result in results:
        if result.markers > 1 and result.row["of"] > 2 * EXTREMES:
            e = result.extents
            found.append(
                f"{result.markers} markers: the worst {EXTREMES} subsets reach over a median of "
                f"{e['worst']:.2f} m, the best over {e['best']:.2f} m, all over {e['all']:.2f} m."
            )
    return found
