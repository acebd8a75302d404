"""The tracking study: tables, figures and sentences of one drive or several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from analysis.study import Study, StudyFigure, StudyTable
from analysis.tracking.drive import Drive, Timeline, load_drive, timeline
from analysis.tracking.figures import consistency_figure, trajectory_figure
from analysis.tracking.findings import findings
from analysis.tracking.statistics import (
    ACCURACY,
    ALL,
    CONSISTENCY,
    MIN_COUNT,
    SETTLED_S,
    acceleration_rms,
    drive_table,
)
from replay.accuracy import FIXES
from replay.result import Result

_KEYS = ["result", "tracker", "side", "markers"]


def study_tracking(results: Sequence[Result]) -> Study:
    """The study of results of drives, told apart by name, or by folder where names are the same.

    Raises:
        InputError: a result lacks a table.
    """
    names = [result.name for result in results]
    unique = len(set(names)) == len(names)
    return study_drives([load_drive(r, None if unique else str(r.folder)) for r in results])


def study_drives(drives: Sequence[Drive]) -> Study:
    """The study of drives in memory."""
    tables, figures, sentences, notes = [], [], [], []
    for i, drive in enumerate(drives, 1):
        frames, table = timeline(drive), drive_table(drive)
        tables.append(table.assign(result=drive.name))
        several = len(drives) > 1
        notes += [f"{drive.name}: {note}" if several else note for note in _notes(frames, table)]
        sentences += [f"{drive.name}: {s}" if several else s for s in findings(table)]
        figures += _figures(drive, frames, table, f"-{i}" if several else "")
    whole = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    return Study(
        "tracking",
        "Tracking",
        _tables(whole, _KEYS if len(drives) > 1 else _KEYS[1:], tuple(notes)),
        tuple(figures),
        tuple(sentences),
    )


def _tables(whole: pd.DataFrame, keys: list[str], notes: tuple[str, ...]) -> tuple[StudyTable, ...]:
    overall, sides = whole[whole["side"] == ALL], whole[whole["side"] != ALL]
    trackers, tracker_sides = (part[part["tracker"] != FIXES] for part in (overall, sides))
    overall_keys = [key for key in keys if key != "side"]
    accuracy_notes = (
        "markers: median of those used in a fix",
        "accel_rms: second differences of the positions over the real time steps, from "
        f"{SETTLED_S:g} s after a track's first fix on; by side, without the step to the next",
        *notes,
    )
    tables = [
        StudyTable(
            "tracking_accuracy",
            "Errors and smoothness over the whole drive",
            _columns(overall, [*overall_keys, *ACCURACY]),
            accuracy_notes,
        ),
        StudyTable(
            "tracking_consistency",
            "Consistency over the whole drive",
            _columns(trackers, [*overall_keys, *CONSISTENCY]),
            CONSISTENCY_NOTES,
        ),
    ]
    if len(sides):
        tables += [
            StudyTable(
                "tracking_accuracy_by_side",
                "Errors and smoothness by side of the path",
                _columns(sides, [*keys, *ACCURACY]),
                notes,
            ),
            StudyTable(
                "tracking_consistency_by_side",
                "Consistency by side of the path",
                _columns(tracker_sides, [*keys, *CONSISTENCY]),
            ),
        ]
    return tuple(tables)


CONSISTENCY_NOTES = (
    "markers: median of those used in a fix",
    "verdict: about the fixes, by the NIS; an error that all fixes share (a marker in the wrong "
    "place, a biased corner) is not in it, only in the NEES",
    "nis_low, nis_high: 95 % band of a mean NIS, chi-square of 2 degrees of freedom an update; "
    "above it a filter is overconfident, below it underconfident",
    "nees_mean: of the position against the exact truth, 2 expected; without a band, because the "
    "errors of one run depend on each other",
    "lag1: autocorrelation of the innovations divided by their σ, white within ± lag1_band",
    "over the whole drive lag1 is that of the innovations that are largest against their σ",
    "log_likelihood: of the innovations, mean of an update (nats); more is better",
    "Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, "
    "section 5.4",
)


def _columns(rows: pd.DataFrame, columns: list[str]) -> pd.DataFrame:
    """The columns, without those that no row has a value for because there is no such truth."""
    frame = rows[columns].reset_index(drop=True)
    for column in {"frames", "updates"} & set(columns):
        frame[column] = frame[column].astype(int)
    for column in ("rmse_x_cm", "rmse_y_cm", "rmse_position_cm", "nees_mean", *_PATH):
        if column in frame and frame[column].isna().all():
            frame = frame.drop(columns=column)
    return frame


_PATH = ("path_rms_cm", "path_max_cm", "in_band_percent")


def _notes(frames: Timeline, table: pd.DataFrame) -> list[str]:
    """What the tables of one drive rest on, and the cells left empty."""
    notes = []
    if len(frames.sides) > 1:
        notes.append(
            f"sides: stretches of the measured path between corners, told by {frames.sides_from}"
        )
    if frames.exact_m is not None:
        everywhere = np.ones(len(frames.side), dtype=np.bool_)
        own = 100.0 * acceleration_rms(frames.time_s, frames.exact_m, everywhere)
        if own == own:
            notes.append(f"the exact truth's own RMS acceleration is {own:.2f} cm/s²")
    trackers = table[table["tracker"] != FIXES]
    for column, what in (("frames", "positions"), ("updates", "innovations")):
        few = trackers[trackers[column].fillna(0) < MIN_COUNT]
        for side, rows in few.groupby("side", sort=False):
            place = "the whole drive" if side == ALL else f"side {side}"
            counts = ", ".join(
                f"{tracker} {int(count)}"
                for tracker, count in zip(rows["tracker"], rows[column].fillna(0), strict=True)
            )
            notes.append(
                f"{place} has fewer than {MIN_COUNT} {what} ({counts}): its cells are empty"
            )
    return notes


def _figures(drive: Drive, frames: Timeline, table: pd.DataFrame, suffix: str) -> list[StudyFigure]:
    of = f" of {drive.name}" if suffix else ""
    figure, outside = trajectory_figure(drive)
    caption = "Fixes as black dots; the measured path with its band in grey" + _outside(outside)
    figures = [StudyFigure(f"tracking_trajectory{suffix}", f"Trajectory{of}", figure, caption)]
    fewest = _fewest_markers(frames, table)
    if fewest is not None:
        side = frames.sides[fewest]
        figure, outside = trajectory_figure(drive, fewest)
        figures.append(
            StudyFigure(
                f"tracking_zoom{suffix}",
                f"Side {side.name}{of}, where the fewest markers were used",
                figure,
                "As before, around one side" + _outside(outside),
            )
        )
    if table["nis_mean"].notna().any():
        figures.append(
            StudyFigure(
                f"tracking_consistency{suffix}",
                f"Consistency{of}",
                consistency_figure(table),
                "Above 2 (NIS: above the grey 95 % band) a filter is overconfident. An error that "
                "all fixes share shows in the NEES only, which needs exact truth",
            )
        )
    return figures


def _outside(count: int) -> str:
    return f"; {count} fixes are further out" if count else ""


def _fewest_markers(frames: Timeline, table: pd.DataFrame) -> int | None:
    """The side with the fewest markers used; None without sides."""
    used = table[table["tracker"] == FIXES].set_index("side")["markers"]
    counts = {i: float(used[side.name]) for i, side in enumerate(frames.sides) if side.name in used}
    known = {i: count for i, count in counts.items() if count == count}
    return min(known, key=lambda i: known[i]) if known else None
