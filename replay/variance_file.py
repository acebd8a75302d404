"""A variance table in a file of its own, put into the settings that point to it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, PositiveFloat

from recorder.errors import InputError
from recorder.files.yaml_file import FileModel, load_yaml, validate

Column = Literal["cm2", "robust_cm2"]

# The models that read a table; elsewhere `path` is a key like any other.
_KINDS = ("table", "static", "fitted")

_Row = Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)]
_Rows = Annotated[list[_Row], Field(min_length=1)]


class VarianceFile(FileModel):
    """What `arucolog analyze variance` writes: σ²x, σ²y in cm² for one, two, … markers.

    Attributes:
        robust_cm2: likewise from the median absolute deviation.
        source: where it comes from, for people.
    """

    cm2: _Rows
    robust_cm2: _Rows | None = None
    source: dict[str, Any] = Field(default={})


def resolve_tables(data: Any, settings_path: Path, base: Path, *, replace: bool = False) -> Any:
    """`data` with every `path: table.yaml` of a variance model replaced by the table in the file.

    Args:
        data: settings as they were read; what is not of the expected shape is left as it is.
        base: folder that paths are relative to.
        replace: a path takes the place of a table; else both together are a mistake.

    Raises:
        InputError: the file is not there or no table, or a model has both a path and a table.
    """
    trackers = data.get("trackers") if isinstance(data, dict) else None
    if not isinstance(trackers, dict):
        return data
    resolved = {
        name: {
            **tracker,
            "variance": _resolve(
                tracker["variance"], settings_path, base, f"trackers.{name}.variance", replace
            ),
        }
        if isinstance(tracker, dict) and "variance" in tracker
        else tracker
        for name, tracker in trackers.items()
    }
    return {**data, "trackers": resolved}


def _resolve(variance: Any, source: Path, base: Path, where: str, replace: bool) -> Any:
    if not isinstance(variance, dict):
        return variance
    # A model may scale another: that one's table is a level deeper.
    variance = {
        key: _resolve(value, source, base, f"{where}.{key}", replace) if key == "base" else value
        for key, value in variance.items()
    }
    if variance.get("kind") not in _KINDS or "path" not in variance:
        return variance
    path = variance.pop("path")
    column = variance.pop("column", "cm2")
    if not isinstance(path, str) or not path:
        raise InputError(source, f"expected the path of a table, found {path!r}", f"{where}.path")
    if column not in get_args(Column):
        expected = " or ".join(get_args(Column))
        raise InputError(source, f"expected {expected}, found {column!r}", f"{where}.column")
    if "table" in variance and not replace:
        raise InputError(source, "expected a path or a table, found both", where)
    return {**variance, "table": {"cm2": read_table(base / path, column)}}


def read_table(path: Path, column: Column = "cm2") -> list[list[float]]:
    """The rows of one column of a file.

    Raises:
        InputError: no such file, no table of variances, or not that column.
    """
    file = validate(VarianceFile, load_yaml(path), path)
    rows: list[list[float]] | None = getattr(file, column)
    if rows is None:
        raise InputError(path, "expected this column, found none", column)
    return rows
