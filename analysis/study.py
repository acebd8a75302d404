"""What a study finds: tables, figures and sentences, kept apart from how they are shown."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorder.files.output_file import write_whole

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class StudyTable:
    """One table.

    Attributes:
        name: stem of its files, such as `rmse_by_class`.
        frame: units in the column names (`rmse_x_cm`); NaN where a statistic has too little data.
        notes: sentences below it: sample sizes, what is left empty and why.
        digits: decimals shown to people; the CSV has all.
    """

    name: str
    title: str
    frame: pd.DataFrame
    notes: tuple[str, ...] = ()
    digits: int = 2


@dataclass(frozen=True)
class StudyFigure:
    """One figure; `caption` says what to see in it."""

    name: str
    title: str
    figure: Figure
    caption: str = ""


@dataclass(frozen=True)
class Study:
    """One study's outcome.

    Attributes:
        findings: whole sentences with their numbers, for people who read nothing else.
    """

    name: str
    title: str
    tables: tuple[StudyTable, ...] = ()
    figures: tuple[StudyFigure, ...] = ()
    findings: tuple[str, ...] = field(default=())


def write_study(study: Study, folder: Path) -> list[Path]:
    """Each table as CSV and LaTeX, each figure as SVG and PNG, into `folder`; the files made."""
    return write_files(folder, study_files(study))


def study_files(study: Study) -> dict[str, bytes]:
    """The content of the study's files by name; the same study gives the same bytes."""
    files = {}
    for table in study.tables:
        files[f"{table.name}.csv"] = table.frame.to_csv(index=False).encode()
        files[f"{table.name}.tex"] = latex(table).encode()
    for figure in study.figures:
        for suffix in ("svg", "png"):
            buffer = io.BytesIO()
            metadata = {"Date": None} if suffix == "svg" else {}
            figure.figure.savefig(buffer, format=suffix, dpi=150, metadata=metadata)
            files[f"{figure.name}.{suffix}"] = buffer.getvalue()
    return files


def write_files(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Writes each file, whole or not at all, in place of an earlier one; the paths made."""
    paths = []
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
        paths.append(path)
    return paths


def latex(table: StudyTable) -> str:
    """A booktabs tabular that needs nothing but the booktabs package."""
    styler = table.frame.style.hide(axis="index")
    styler = styler.format(precision=table.digits, na_rep="--", escape="latex")
    styler = styler.format_index(escape="latex", axis="columns")
    caption = re.sub(r"([%&_#$])", r"\\\1", table.title)
    text: str = styler.to_latex(hrules=True, caption=caption, label=f"tab:{table.name}")
    return text


def text(study: Study) -> str:
    """The study for a terminal: tables, notes, findings."""
    parts = [study.title]
    for table in study.tables:
        shown = table.frame.to_string(
            index=False, float_format=f"{{:.{table.digits}f}}".format, na_rep="-"
        )
        parts.append("\n".join([table.title, shown, *(f"  {note}" for note in table.notes)]))
    if study.findings:
        parts.append("\n".join(study.findings))
    return "\n\n".join(parts)


def as_json(study: Study) -> dict[str, Any]:
    """The study for other programs: rows of each table, null where a cell is empty."""
    return {
        "study": study.name,
        "tables": {
            table.name: {
                "title": table.title,
                "rows": json.loads(table.frame.to_json(orient="records")),
                "notes": list(table.notes),
            }
            for table in study.tables
        },
        "findings": list(study.findings),
    }
