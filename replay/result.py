"""The folder that a replay leaves: written whole or not at all, and read back with checks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.localizer import PipelineSettings
from recorder.errors import InputError
from replay.settings_file import load_settings
from replay.tables import SCHEMAS, TABLES_VERSION

if TYPE_CHECKING:
    import pandas as pd

SUMMARY = "summary.json"


def check_free(folder: Path, *, force: bool) -> None:
    """A result may be written to `folder`.

    Raises:
        InputError: it exists (without `force`), or is no result and may not be replaced.
    """
    if not folder.exists():
        return
    if not force:
        raise InputError(folder, "already exists; --force replaces it, --name gives another")
    if not folder.is_dir() or (any(folder.iterdir()) and not (folder / SUMMARY).exists()):
        raise InputError(folder, "expected a result to replace, found something else")


@contextmanager
def new_result(folder: Path, *, force: bool = False) -> Iterator[Path]:
    """A temporary folder that becomes `folder` when the block ends well, and vanishes otherwise.

    Raises:
        InputError: as `check_free`.
    """
    check_free(folder, force=force)
    made = [p for p in (folder.parent, *folder.parent.parents) if not p.exists()]
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Of its own for each process: two replays to one place must not write into each other.
    temporary = Path(mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    temporary.chmod(0o755)
    try:
        yield temporary
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        for parent in made:
            with suppress(OSError):
                parent.rmdir()
        raise
    if not folder.exists():
        temporary.rename(folder)
        return
    if not force:
        shutil.rmtree(temporary)
        raise InputError(folder, "was made by another replay meanwhile; --name gives another")
    # At no moment is there neither the old result nor the new one.
    old = folder.with_name(f".{folder.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    folder.rename(old)
    temporary.rename(folder)
    shutil.rmtree(old)


@dataclass(frozen=True)
class Result:
    """A replay's result, opened by `open_result`."""

    folder: Path
    summary: dict[str, Any]

    @property
    def name(self) -> str:
        return str(self.summary["name"])

    @cached_property
    def settings(self) -> PipelineSettings:
        """The resolved settings that it was replayed with."""
        return load_settings(self.folder / "settings.yaml")

    def table(self, name: str) -> pd.DataFrame:
        """One of the tables.

        Raises:
            InputError: the result has no such table, a damaged one, or one without its columns.
        """
        path = self.folder / f"{name}.parquet"
        if not path.exists():
            raise InputError(path, "expected a table of the result, found none")
        try:
            table = pq.read_table(path)
        except (pa.ArrowException, OSError) as error:
            found = str(error).rstrip(".")
            raise InputError(path, f"expected a Parquet table, found: {found}") from error
        missing = [c for c in SCHEMAS[name].names if c not in table.column_names]
        if missing:
            raise InputError(path, f"expected the column {missing[0]}, found none")
        frame: pd.DataFrame = table.to_pandas()
        return frame


def open_result(folder: Path) -> Result:
    """The result in a folder.

    Raises:
        InputError: it is no result, or one whose tables are of another version.
    """
    path = folder / SUMMARY
    if not folder.is_dir():
        raise InputError(folder, "expected a folder made by `arucolog replay`, found none")
    if not path.exists():
        raise InputError(folder, f"expected a folder made by `arucolog replay`, found no {SUMMARY}")
    try:
        summary = json.loads(path.read_text())
    except ValueError as error:
        raise InputError(path, f"expected JSON, found: {error}") from error
    version = summary.get("tables_version") if isinstance(summary, dict) else None
    if version != TABLES_VERSION:
        raise InputError(
            path,
            f"expected version {TABLES_VERSION}, found {version}; replay the log again",
            "tables_version",
        )
    return Result(folder, summary)
