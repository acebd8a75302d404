"""Where a log is written until it is whole."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path

from recorder.errors import InputError
from recorder.log.log_file import RawFile


def target_of(path: Path, force: bool) -> Path:
    """The file to write into: `path`, or one beside it while there is something at `path`.

    Raises:
        InputError: it exists and may not be replaced.
    """
    if not path.exists():
        return path
    if path.is_dir():
        raise InputError(path, "expected a file, found a folder")
    if not force:
        raise InputError(path, "expected a new file, found one that exists (--force replaces it)")
    # What a killed recording left is somebody's only copy.
    beside = (path.with_name(f"{path.name}.part{n if n > 1 else ''}") for n in count(1))
    return next(candidate for candidate in beside if not candidate.exists())


def open_target(open_raw: Callable[[Path], RawFile] | None, path: Path) -> RawFile:
    """A new unbuffered file.

    Raises:
        InputError: it cannot be made.
    """
    try:
        return (open_raw or _open_raw)(path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(path, f"expected a file that can be written, found: {reason}") from error


def _open_raw(path: Path) -> RawFile:
    return open(path, "xb", buffering=0)
