"""Which studies a set of results allows, and the report of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.compare import compare
from analysis.report.page import page
from analysis.static.count import count
from analysis.static.placement import placement
from analysis.static.subsets import SubsetOptions
from analysis.static.view import MovedError, open_view
from analysis.study import Study, StudyTable, write_study
from analysis.tracking.study import study_tracking
from replay.result import Result, open_result


@dataclass(frozen=True)
class Report:
    """What was written: the page, and a folder with each table as CSV and LaTeX, each figure."""

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
    studies = []
    for log in dict.fromkeys(str(result.summary["log_sha256"]) for result in results):
        tick("comparison")
        studies.append(_comparison([r for r in results if r.summary["log_sha256"] == log]))
    if still:
        tick("placement")
        studies.append(placement([result.folder for result in still]))
        for result in still:
            tick(f"number of markers, {result.summary['log']}")
            studies.append(count(result.folder, SubsetOptions(sample=sample)))
    if driven:
        tick("tracking")
        studies.append(study_tracking(driven))
    files = out.with_name(f"{out.stem}_files")
    for i, study in enumerate(studies, 1):
        write_study(study, files / f"{i}-{study.name}")
    text = page(title or _title(results), studies, results)
    temporary = out.with_name(f".{out.name}.part")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(out)
    return Report(out, files, tuple(study.title for study in studies))


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
