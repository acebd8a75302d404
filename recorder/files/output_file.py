"""A file as the output of a command: whole or not at all, and never over another unasked."""

from __future__ import annotations

import os
from pathlib import Path

from recorder.errors import InputError


def check_free(path: Path, *, force: bool) -> None:
    """Before the work rather than after it.

    Raises:
        InputError: `path` exists and `force` is not given, is a folder, or its folder is missing.
    """
    if path.is_dir():
        raise InputError(path, "expected a file to write, found a folder")
    if not path.parent.is_dir():
        raise InputError(path, f"expected the folder {path.parent}, found none")
    if path.exists() and not force:
        raise InputError(path, "expected no such file yet, found one (--force replaces it)")


def write_output(path: Path, data: bytes, *, force: bool) -> None:
    """`data` as the file `path`, through a file beside it.

    Raises:
        InputError: as `check_free`.
    """
    check_free(path, force=force)
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(data)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
