"""Where a log is written until it is whole."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from io import FileIO
from itertools import count
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

from recorder.errors import InputError
from recorder.log.log_file import RawFile


def target_of(path: Path, force: bool) -> Path:
    """The file to write into: `path`, or one beside it while there is something at `path`.

    Raises:
        InputError: it exists and may not be replaced, or is being written.
    """
    if not path.exists():
        return path
    if path.is_dir():
        raise InputError(path, "expected a file, found a folder")
    if not force:
        raise InputError(path, "expected a new file, found one that exists (--force replaces it)")
    if _is_being_written(path):
        raise InputError(path, "expected a log to replace, found one that is being recorded")
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


def _is_being_written(path: Path) -> bool:
    if fcntl is None:
        return False
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass
    return False


def _open_raw(path: Path) -> RawFile:
    raw = FileIO(path, "xb")
    if fcntl is not None:
        # Until it is closed, also by a kill. A file system without locks only lacks the message.
        with suppress(OSError):
            fcntl.flock(raw, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return raw
