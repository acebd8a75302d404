"""Which studies a set of results allows, and the report of them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from analysis.compare import compare
from analysis.report.page import page
from analysis.static.count import study_count
from analysis.static.placement import study_placement
from analysis.static.subsets import SubsetOptions
from analysis.static.variance_table import DEFAULTS, VarianceStudy, study_variance
from analysis.static.view import MovedError, StillView, open_view
from analysis.study import Study, StudyTable, study_files, write_files
from analysis.tracking.study import study_tracking
from recorder.errors import InputError
from replay.result import Result, open_result

# The folders of an earlier report, which a new one replaces.
_OWN = re.compile(r"\d+-(comparison|placement|count|variance|tracking)")


@dataclass(frozen=True)
class Report:
    """What was written: the page, and a folder with each table as CSV and LaTeX, each figure.

    In the folders of variances lies also the `table.yaml` that settings can point to.

    Attributes:
        without: sentences that name what could not be studied, and why; they are on the page too.
    """

    page: Path
    files: Path
    studies: tuple[str, ...]
    without: tuple[str, ...]


def report(
    folders: Sequence[Path],
    out: Path,
    *,
    title: str | None = None,
    sample: int | None = None,
    tick: Callable[[str], None] = lambda _: None,
) -> Report:
    """Writes the page of all studies that the results allow: still cameras, drives, or both.

    A result that allows none is on the page with the reason.

    Args:
        sample: at most so many random subsets of each size in the study of the number of markers.
        tick: called with the name of each study before it begins.

    Raises:
        InputError: a folder is no result.
    """
    results = [open_result(folder) for folder in folders]
    still, driven, without = _sorted(results)
    studies: list[Study] = []
    files: dict[str, bytes] = {}

    def add(study: Study, table: str | None = None) -> None:
        studies.append(study)
        folder = f"{len(studies)}-{study.name}"
        files.update({f"{folder}/{name}": data for name, data in study_files(study).items()})
        if table is not None:
            files[f"{folder}/table.yaml"] = table.encode()

    def attempt(name: str, title: str, of: str, study: Callable[[], Study]) -> None:
        tick(f"{title.lower()}{of}")
        try:
            add(_titled(study(), of))
        except InputError as error:
            without.append(f"{title}{of}: {error}.")
            add(Study(name, f"{title}{of}", findings=(f"Not studied: {error}.",)))

    for log in dict.fromkeys(str(result.summary["log_sha256"]) for result in results):
        tick("comparison")
        add(_comparison([r for r in results if r.summary["log_sha256"] == log]))
    if still:
        attempt("placement", "Placement of single markers", "", lambda: study_placement(still))
    for view in still:
        of = f", {view.result.summary['log']}"
        options = SubsetOptions(sample=sample)
        attempt("count", "Number of markers", of, partial(study_count, view, options))
        tick(f"variances{of}")
        measured = _variance(view, sample)
        if isinstance(measured, VarianceStudy):
            add(_titled(measured.study, of), measured.content("table.yaml"))
        else:
            add(_titled(measured, of))
    if driven:
        attempt("tracking", "Tracking", "", lambda: study_tracking(driven))
    if without:
        add(Study("without", "Without a study", findings=tuple(without)))
    text = page(title or _title(results), studies, results)
    # Everything is made; from here on only the disk can fail.
    folder = out.with_name(f"{out.stem}_files")
    for earlier in folder.glob("*"):
        if _OWN.fullmatch(earlier.name) and earlier.is_dir() and not earlier.is_symlink():
            shutil.rmtree(earlier)
    write_files(folder, files)
    write_files(out.parent, {out.name: text.encode()})
    return Report(out, folder, tuple(study.title for study in studies), tuple(without))


def _sorted(results: Sequence[Result]) -> tuple[list[StillView], list[Result], list[str]]:
    """Still cameras, drives, and why the others are neither."""
    still, driven, without = [], [], []
    for result in results:
        try:
            still.append(open_view(result.folder))
        except MovedError:
            driven.append(result)
        except InputError as error:
            without.append(f"{result.name}: {error}.")
    return still, driven, without


def _variance(view: StillView, sample: int | None) -> VarianceStudy | Study:
    options = DEFAULTS if sample is None else replace(DEFAULTS, sample=sample)
    try:
        return study_variance(view, options)
    except InputError as error:
        title = "Variances by number of markers"
        return Study("variance", title, findings=(f"Not measured: {error}.",))


def _titled(study: Study, of: str) -> Study:
    """With what it is of, which tells two of a kind apart."""
    return replace(study, title=f"{study.title}{of}")


def _comparison(results: Sequence[Result]) -> Study:
    log = results[0].summary["log"]
    table = StudyTable(
        "comparison",
        "Filters, the settings that differ, and errors",
        compare([result.folder for result in results]),
    )
    return Study("comparison", f"Comparison: {log}", (table,))


def _title(results: Sequence[Result]) -> str:
    logs = list(dict.fromkeys(str(result.summary["log"]) for result in results))
    return "Localization report: " + ", ".join(logs)
