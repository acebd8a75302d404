"""The placement study: each marker alone, by ring, rotation class and camera height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.static.alone import AXES, Alone, solve_alone
from analysis.static.statistics import MIN_MARKERS, STATISTICS, Bootstrap, statistics, wilson
from analysis.static.view import StillView, open_view
from analysis.study import Study, StudyTable
from pipeline.geometry import Array

if TYPE_CHECKING:
    import pandas as pd

# With fewer the errors that the markers of a frame have in common are little known.
FEW_FRAMES = 10

TITLES = {
    "rmse": "Root mean square error",
    "bias": "Mean error",
    "std": "Standard deviation about the mean",
    "max": "Largest error",
    "q95": "95 % quantile of the error's magnitude",
}


@dataclass(frozen=True)
class PlacementOptions:
    """`large_cm`: errors above count as large; `progress`: bars on a terminal."""

    bootstrap: Bootstrap = field(default_factory=Bootstrap)
    large_cm: float = 20.0
    progress: bool = True


def placement(folders: Sequence[Path], options: PlacementOptions | None = None) -> Study:
    """The study of one or more results of a camera standing still, the nearest first.

    Raises:
        InputError: one is no result, shows no known marker, or its camera moved.
    """
    return study_placement([open_view(folder) for folder in folders], options)


def study_placement(opened: Sequence[StillView], options: PlacementOptions | None = None) -> Study:
    """The study of one or more views, the nearest first."""
    from analysis.static import pairs, placement_figures, placement_findings

    options = options or PlacementOptions()
    views = solve_alone(opened, progress=options.progress)
    known = [view for view in views if view.has_truth]
    tables = [*_statistic_tables(views, options)]
    findings = [
        *placement_findings.height_findings(known),
        *placement_findings.class_findings(known),
    ]
    figures = []
    if known:
        share = share_table(known, options)
        figures = [
            placement_figures.distribution(known),
            placement_figures.shares(share, known, options.large_cm),
        ]
        tables.append(share)
        findings += placement_findings.ring_findings(share.frame, known, options.large_cm)
        studied = [
            (view, found)
            for view in known
            if (found := pairs.solve_pairs(view.view, progress=options.progress))
        ]
        without = [view.label for view in known if view not in [s for s, _ in studied]]
        if without:
            findings.append(
                f"No study of pairs at {', '.join(without)}: fewer than {pairs.MIN_PAIRS} pairs."
            )
        if studied:
            tables.append(pairs.table([(view.height, found) for view, found in studied]))
        for view, found in studied:
            figures.append(placement_figures.pairs(view, found))
            findings += pairs.findings(view.label, found)
    return Study(
        "placement", "Placement of single markers", tuple(tables), tuple(figures), tuple(findings)
    )


def _statistic_tables(views: Sequence[Alone], options: PlacementOptions) -> list[StudyTable]:
    """RMSE and mean error as in the paper, then each statistic with its interval."""
    import pandas as pd

    rows = [_row(view, n, options) for view in views for n in range(len(view.grouping.rows))]
    whole = pd.DataFrame(rows)
    head = ["height_m", "group", "markers", "fixes"]
    wanted = STATISTICS if any(view.has_truth for view in views) else ("std",)
    notes = _notes(views)
    tables = []
    if "rmse" in wanted:
        columns = [f"{s}_{axis}_{unit}" for s in ("rmse", "bias") for axis, _, unit, _ in AXES]
        tables.append(
            StudyTable(
                "placement",
                "One marker alone: RMSE and mean error",
                whole[[*head, "rejected", *columns]],
                notes,
            )
        )
        notes = ()
    notes += _interval_notes(views, options.bootstrap)
    for statistic in wanted:
        columns = [
            f"{statistic}_{axis}{end}_{unit}"
            for axis, _, unit, _ in AXES
            for end in ("", "_low", "_high")
        ]
        if statistic == "max":
            notes += (
                "The largest error's interval is the middle of what resampling gives: it says how "
                "much hangs on single markers, not what other markers would do. No resample is "
                "above the largest error seen.",
            )
        tables.append(
            StudyTable(
                f"placement_{statistic}",
                f"One marker alone: {TITLES[statistic].lower()}, with its interval",
                whole[[*head, *columns]],
                (*notes, *_without_interval(whole, statistic)),
            )
        )
        notes = ()
    return tables


def _row(view: Alone, number: int, options: PlacementOptions) -> dict[str, Any]:
    row_group = view.grouping.rows[number]
    errors = view.of(row_group.ids)
    row: dict[str, Any] = {
        "height_m": view.height,
        "group": row_group.name,
        "markers": len(row_group.ids),
        # Those that the statistics are of: with a truth, where it is known.
        "fixes": int(np.isfinite(errors[..., 0]).sum()),
        "rejected": int(view.fixes.rejected[:, view.fixes.columns(row_group.ids)].sum()),
    }
    for axis, column, unit, _ in AXES:
        found = statistics(errors[..., column])
        intervals = options.bootstrap.intervals(errors[..., column])
        for statistic in STATISTICS:
            given = view.has_truth or statistic == "std"
            low, high = intervals[statistic] if given else (np.nan, np.nan)
            row[f"{statistic}_{axis}_{unit}"] = found[statistic] if given else np.nan
            row[f"{statistic}_{axis}_low_{unit}"] = low
            row[f"{statistic}_{axis}_high_{unit}"] = high
    return row


def _notes(views: Sequence[Alone]) -> tuple[str, ...]:
    frames = "; ".join(
        f"{view.label}: {len(view.view.frames)} frames, {view.view.truth_note}" for view in views
    )
    by_tags = all(view.grouping.by_tags for view in views)
    return (
        f"{frames}.",
        "Groups by the map's tags."
        if by_tags
        else "No ring tags in the map: rings are thirds of the markers by distance from the "
        "image centre.",
        "All finite poses count, also those that the pipeline's checks refuse (rejected).",
    )


def _interval_notes(views: Sequence[Alone], bootstrap: Bootstrap) -> tuple[str, ...]:
    notes: tuple[str, ...] = (
        f"Intervals: {100 * bootstrap.level:g} %, bootstrap over frames and markers, "
        f"{bootstrap.resamples} resamples, seed {bootstrap.seed}: their standard error times "
        "Student's t with the number of markers (all but the mean: on the logarithm). Measured, "
        "they hold the truth in at least 93 % of cases for normal errors and 87 % for heavy-tailed "
        "ones, but in as few as 76 % where a few markers err far more than the rest.",
    )
    fewest = min(len(view.view.frames) for view in views)
    if fewest == 1:
        notes += ("With a single frame the intervals know the markers' scatter only.",)
    elif fewest < FEW_FRAMES:
        notes += (
            f"With fewer than {FEW_FRAMES} frames the intervals are too narrow if all markers of "
            "a frame err together.",
        )
    return notes


def _without_interval(whole: pd.DataFrame, statistic: str) -> tuple[str, ...]:
    """Sentences that name what is empty, and why."""
    column = whole[f"{statistic}_x_cm"]
    no_yaw = whole[column.notna() & whole[f"{statistic}_yaw_deg"].isna()]
    values = whole[[f"{statistic}_{axis}_{unit}" for axis, _, unit, _ in AXES]]
    lows = whole[[f"{statistic}_{axis}_low_{unit}" for axis, _, unit, _ in AXES]]
    bare = whole[(values.notna().to_numpy() & lows.isna().to_numpy()).any(axis=1)]
    empty = whole[column.isna()]
    notes: tuple[str, ...] = ()
    if len(bare):
        names = ", ".join(f"{row.group} at a height of {row.height_m}" for row in bare.itertuples())
        notes += (
            f"No interval for fewer than {MIN_MARKERS} markers, or where all err the same: "
            f"{names}.",
        )
    if len(empty):
        names = ", ".join(
            f"{row.group} at a height of {row.height_m}" for row in empty.itertuples()
        )
        notes += (f"Empty for want of fixes or of a truth: {names}.",)
    if len(no_yaw):
        heights = ", ".join(dict.fromkeys(no_yaw["height_m"]))
        notes += (f"Yaw is empty where the truth has no heading: height {heights}.",)
    return notes


def share_table(views: Sequence[Alone], options: PlacementOptions) -> StudyTable:
    """The share of markers and of single fixes with a large horizontal error, by ring."""
    import pandas as pd

    rows = []
    for view in views:
        for ring in view.grouping.rings:
            cm = 100.0 * view.fixes.horizontal_m[:, view.fixes.columns(ring.ids)]
            known = np.isfinite(cm)
            solved = known.any(axis=0)
            rms = np.sqrt(np.nansum(cm[:, solved] ** 2, axis=0) / known[:, solved].sum(axis=0))
            above = np.where(known, cm > options.large_cm, np.nan)
            low, high = options.bootstrap.share_interval(above)
            few, many = wilson(int((rms > options.large_cm).sum()), len(rms))
            rows.append(
                {
                    "height_m": view.height,
                    "ring": ring.name,
                    "markers": len(rms),
                    "markers_above_pct": _percent(rms > options.large_cm),
                    "markers_low_pct": 100.0 * few,
                    "markers_high_pct": 100.0 * many,
                    "fixes": int(known.sum()),
                    "fixes_above_pct": _percent(above[known]),
                    "fixes_low_pct": 100.0 * low,
                    "fixes_high_pct": 100.0 * high,
                }
            )
    return StudyTable(
        "placement_share",
        f"Share of errors above {options.large_cm:g} cm by ring",
        pd.DataFrame(rows),
        (
            "A marker counts when the root mean square over its frames of the horizontal position "
            f"error is above {options.large_cm:g} cm (interval: Wilson, over markers); a fix when "
            "its own error is (interval: Wilson, over as many independent fixes as would scatter "
            "like the resamples of the bootstrap).",
        ),
    )


def _percent(flags: Array) -> float:
    return 100.0 * float(np.mean(flags)) if len(flags) else np.nan
