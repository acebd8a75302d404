"""Where a log is written until it is whole."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from io import FileIO
from itertools import count
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

from recorder.errors import InputError
from recorder.log.log_file import RawFile, sync_folder

# Longer than anybody takes to choose a name or to rename; a lock of others is not waited for.
_PATIENCE_S = 1.0


class DisplacedError(InputError):
    """What was to be replaced is not there any more, but something else: both are kept."""


class Target:
    """The new file that a log is written into: `path`, or one beside it while `path` exists.

    Of all who want to write `path`, one may at a time.

    Attributes:
        written_to: the file; `path` once it took its place.
        raw: it, unbuffered.
    """

    def __init__(
        self, path: Path, *, force: bool, open_raw: Callable[[Path], RawFile] | None = None
    ) -> None:
        """
        Raises:
            InputError: `path` exists and may not be replaced, somebody writes it, or it cannot be
                made.
        """
        self.path = path
        if not path.parent.is_dir():
            raise InputError(path, f"expected the folder {path.parent}, found none")
        with _alone_in(path.parent):
            self._before = _state(path)
            self.written_to = _name_for(path, force)
            self.raw = _opened(open_raw or _open_raw, self.written_to)

    @property
    def is_beside(self) -> bool:
        """It is to take the place of another file."""
        return self.written_to != self.path

    def take_place(self, *, is_ours: bool) -> None:
        """Put the file, closed and whole, where the one is that it replaces.

        Args:
            is_ours: `written_to` was this file when it was closed.

        Raises:
            DisplacedError: the one to replace was changed or replaced since this one was begun.
            InputError: somebody removed this one.
        """
        if not is_ours:
            raise InputError(
                self.written_to,
                "expected the log that was written, found that it was removed or replaced",
            )
        # Where files cannot be locked, another recorder may have been at work.
        with _alone_in(self.path.parent):
            if _state(self.path) not in (None, self._before):
                raise DisplacedError(
                    self.path,
                    "expected the log that was to be replaced, found that it has changed since; "
                    f"it stays, the new one is {self.written_to}",
                )
            os.replace(self.written_to, self.path)
        self.written_to = self.path
        sync_folder(self.path.parent)


def _name_for(path: Path, force: bool) -> Path:
    if path.is_dir():
        raise InputError(path, "expected a file, found a folder")
    exists = path.exists()
    if exists and not force:
        raise InputError(path, "expected a new file, found one that exists (--force replaces it)")
    if _is_being_written(path):
        raise InputError(path, "expected a log to replace, found one that is being recorded")
    for beside in path.parent.glob(f"{escape(path.name)}.part*"):
        if _is_being_written(beside):
            raise InputError(
                path,
                f"expected a log that nobody else writes, found {beside.name}, which is being "
                "recorded to take its place",
            )
    if not exists:
        return path
    # What a killed recording left is somebody's only copy.
    names = (path.with_name(f"{path.name}.part{n if n > 1 else ''}") for n in count(1))
    return next(name for name in names if not name.exists())


def _opened(open_raw: Callable[[Path], RawFile], path: Path) -> RawFile:
    try:
        return open_raw(path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(path, f"expected a file that can be written, found: {reason}") from error


def _open_raw(path: Path) -> RawFile:
    raw = FileIO(path, "xb")
    if fcntl is not None:
        # Until it is closed, also by a kill. A file system without locks only lacks the message.
        with suppress(OSError):
            fcntl.flock(raw, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return raw


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


def _state(path: Path) -> tuple[int, ...] | None:
    """What changes when a file is replaced or written to; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Nobody else chooses a name in `folder`, or gives one, inside; as far as it can be locked."""
    number = None
    if fcntl is not None:
        with suppress(OSError):
            number = os.open(folder, os.O_RDONLY)
    try:
        if number is not None:
            _lock(number)
        yield
    finally:
        if number is not None:
            os.close(number)


def _lock(number: int) -> None:
    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() < until:
                time.sleep(0.01)
                continue
        except OSError:
            pass
        return
