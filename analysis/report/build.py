"""Which studies a set of results allows, and the report of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from analysis.compare import compare
from analysis.report.page import page
from analysis.static.count import count
from analysis.static.placement import placement
from analysis.static.subsets import SubsetOptions
from analysis.static.variance_table import DEFAULTS, study_variance
from analysis.static.view import MovedError, open_view
from analysis.study import Study, StudyTable, study_files, write_files
from analysis.tracking.study import study_tracking
from recorder.errors import InputError
from replay.result import Result, open_result


@dataclass(frozen=True)
class Report:
    """What was written: the page, and a folder with each table as CSV and LaTeX, each figure.

    In the folders of variances lies also the `table.yaml` that settings can point to.
    """

    page: Path
    files: Path
    studies: tuple[str, ...]


def report(
    folders: Sequence[Path],
    out: Path,
    *,
    title: str | None = None,
    sample: int | None = None,
    tick: Callable[[str], None] = lambda _: None,
) -> Report:
    """Writes the page of all studies that the results allow: still cameras, drives, or both.

    Args:
        sample: at most so many random subsets of each size in the study of the number of markers.
        tick: called with the name of each study before it begins.

    Raises:
        InputError: a folder is no result.
    """
    results = [open_result(folder) for folder in folders]
    still = [result for result in results if _stands_still(result)]
    driven = [result for result in results if result not in still]
    studies: list[Study] = []
    files: dict[str, bytes] = {}

    def add(study: Study, **more: str) -> None:
        studies.append(study)
        for name, content in study_files(study).items():
            files[f"{len(studies)}-{study.name}/{name}"] = content
        for name, text in more.items():
            files[f"{len(studies)}-{study.name}/{name}.yaml"] = text.encode()

    for log in dict.fromkeys(str(result.summary["log_sha256"]) for result in results):
        tick("comparison")
        add(_comparison([r for r in results if r.summary["log_sha256"] == log]))
    if still:
        tick("placement")
        add(placement([result.folder for result in still]))
        for result in still:
            log = result.summary["log"]
            tick(f"number of markers, {log}")
            add(count(result.folder, SubsetOptions(sample=sample)))
            tick(f"variances, {log}")
            add(**_variance(result, sample))
    if driven:
        tick("tracking")
        add(study_tracking(driven))
    text = page(title or _title(results), studies, results)
    # Everything is made; from here on only the disk can fail.
    folder = out.with_name(f"{out.stem}_files")
    for earlier in folder.glob("[0-9]*-*"):
        shutil.rmtree(earlier)
    write_files(folder, files)
    write_files(out.parent, {out.name: text.encode()})
    return Report(out, folder, tuple(study.title for study in studies))


def _variance(result: Result, sample: int | None) -> dict[str, Any]:
    options = DEFAULTS if sample is None else replace(DEFAULTS, sample=sample)
    try:
        measured = study_variance(result.folder, options)
    except InputError as error:
        title = "Variances by number of markers"
        return {"study": Study("variance", title, findings=(f"Not measured: {error}.",))}
    return {"study": measured.study, "table": measured.content("table.yaml")}


def _stands_still(result: Result) -> bool:
    try:
        open_view(result.folder)
    except MovedError:
        return False
    return True


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
