"""The HTML page: figures inside it, nothing from the network."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata, resources
from typing import Any

import jinja2
import pandas as pd

from analysis.study import Study, StudyFigure, StudyTable
from replay.result import Result


@dataclass(frozen=True)
class _Cell:
    value: str
    text: bool


def page(title: str, studies: Sequence[Study], results: Sequence[Result]) -> str:
    """The whole page as text."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    source = resources.files("analysis.report").joinpath("page.html.j2").read_text("utf-8")
    return environment.from_string(source).render(
        title=title,
        version=metadata.version("arucolog"),
        studies=[_study(study, i) for i, study in enumerate(studies)],
        results=[_result(result) for result in results],
    )


def _study(study: Study, number: int) -> dict[str, Any]:
    return {
        "anchor": f"{number + 1}-{study.name}",
        "title": study.title,
        "findings": study.findings,
        "tables": [_table(table) for table in study.tables],
        "figures": [_figure(figure) for figure in study.figures],
    }


def _table(table: StudyTable) -> dict[str, Any]:
    frame = table.frame
    text = [not pd.api.types.is_numeric_dtype(frame[column]) for column in frame.columns]
    return {
        "title": table.title,
        "notes": table.notes,
        "columns": [
            {"name": str(name).replace("_", " "), "text": is_text}
            for name, is_text in zip(frame.columns, text, strict=True)
        ],
        "rows": [
            [
                _Cell(_shown(value, table.digits), is_text)
                for value, is_text in zip(row, text, strict=True)
            ]
            for row in frame.itertuples(index=False)
        ],
    }


def _shown(value: object, digits: int) -> str:
    """A cell as people read it; empty statistics are a dash, never a number."""
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return "–"
    if isinstance(value, float):
        return f"{value:.{digits}f}"
    return str(value)


def _figure(figure: StudyFigure) -> dict[str, str]:
    buffer = io.BytesIO()
    figure.figure.savefig(buffer, format="svg", metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    return {
        "title": figure.title,
        "caption": figure.caption,
        "source": f"data:image/svg+xml;base64,{data}",
    }


def _result(result: Result) -> dict[str, Any]:
    summary = result.summary
    counts = sorted(summary["status"].items(), key=lambda item: -item[1])
    return {
        "name": result.name,
        "log": summary["log"],
        "sha256": summary["log_sha256"],
        "frames": summary["frames"],
        "status": ", ".join(f"{n} {status}" for status, n in counts),
        "cut_short": summary["log_cut_short"],
        "settings": (result.folder / "settings.yaml").read_text(),
    }
