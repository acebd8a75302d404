"""A file as the output of a command: named as what it is, whole, never over another unasked."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from recorder.errors import InputError

YAML = (".yaml", ".yml")
HTML = (".html", ".htm")
LOG = (".mcap",)


def check_suffix(path: Path | None, known: Sequence[str]) -> None:
    """Before the work: what is written is later read, and told from other files, by its suffix.

    Args:
        path: None where nothing is to be written.
        known: in lower case; either case is good.

    Raises:
        InputError: `path` ends in none of them.
    """
    if path is None or path.suffix.lower() in known:
        return
    *others, last = known
    wanted = f"{', '.join(others)} or {last}" if others else last
    found = path.suffix or "no suffix"
    raise InputError(path, f"expected {wanted}, found {found}, for the file to write")


def check_free(path: Path, *, force: bool) -> None:
    """Before the work rather than after it.

    Raises:
        InputError: `path` exists and `force` is not given, is a folder, or its folder is missing or
            not to be written to.
    """
    if path.is_dir():
        raise InputError(path, "expected a file to write, found a folder")
    if not path.parent.is_dir():
        raise InputError(path, f"expected the folder {path.parent}, found none")
    if not os.access(path.parent, os.W_OK):
        raise InputError(path, f"expected to write to the folder {path.parent}, found it read-only")
    if path.exists() and not force:
        raise InputError(path, "expected no such file yet, found one (--force replaces it)")


def write_output(path: Path, data: bytes, *, force: bool) -> None:
    """`data` as the file `path`.

    Raises:
        InputError: as `check_free`.
    """
    check_free(path, force=force)
    write_whole(path, data)


def write_whole(path: Path, data: bytes) -> None:
    """Writes a file in place of an earlier one; where that fails, the earlier one stays.

    Raises:
        OSError: the file cannot be written; nothing else is left of it.
    """
    temporary = _temporary(path)
    try:
        _write(temporary, data, path)
        _rename(temporary, path)
    finally:
        _remove(temporary)


def write_together(files: Mapping[Path, bytes], *, force: bool) -> None:
    """Files that say something only together: all of them, or what was there before.

    Raises:
        InputError: as `check_free`.
        OSError: one of them cannot be written.
    """
    for path in files:
        check_free(path, force=force)
    temporaries = {path: _temporary(path) for path in files}
    replaced: dict[Path, bytes | None] = {}
    try:
        # A full disk shows before anything is replaced.
        for path, data in files.items():
            _write(temporaries[path], data, path)
        for path, temporary in temporaries.items():
            earlier = path.read_bytes() if path.exists() else None
            _rename(temporary, path)
            replaced[path] = earlier
    except BaseException:
        for path, earlier in replaced.items():
            if earlier is None:
                path.unlink()
            else:
                write_whole(path, earlier)
        raise
    finally:
        for temporary in temporaries.values():
            _remove(temporary)


def _write(temporary: Path, data: bytes, path: Path) -> None:
    try:
        temporary.write_bytes(data)
    except OSError as error:
        # A full disk names no file, a folder without permission the temporary one.
        raise OSError(error.errno, error.strerror, str(path)) from error


def _rename(temporary: Path, path: Path) -> None:
    try:
        temporary.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def _remove(temporary: Path) -> None:
    """What is in the way is told by the write; a read-only disk refuses even what is not there."""
    with suppress(OSError):
        temporary.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    """Of its own for each process: two that write the same file do not write into each other's."""
    return path.with_name(f".{path.name}.{os.getpid()}.part")
