"""The file under a log that is being written, with space set aside for its end."""

from __future__ import annotations

import errno
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Protocol

_STEP = 1 << 20

# Contents and size without the times of the file: half the work, where there is the choice.
fdatasync = getattr(os, "fdatasync", os.fsync)


class DiskFullError(Exception):
    """No more space; what the log already promised still fits into the reserve."""


class RawFile(Protocol):
    """What is needed of an unbuffered binary file."""

    def write(self, data: memoryview, /) -> int | None: ...
    def truncate(self, size: int, /) -> int: ...
    def close(self) -> None: ...


class LogFile:
    """Writes to `raw`; when the disk is full it falls back on space it holds in reserve.

    The reserve is a nameless file in the same folder (a killed recording leaves none behind), kept
    at least as large as what the log still has to write: its open chunk and its summary.

    Attributes:
        full: the disk is full and the reserve has been given up.
    """

    def __init__(self, raw: RawFile, folder: Path) -> None:
        self._raw = raw
        self._folder = folder
        self._reserve: BinaryIO | None = None
        self._reserved = 0
        self._position = 0
        self.full = False

    def ensure(self, size: int) -> None:
        """Hold at least `size` bytes in reserve.

        Raises:
            DiskFullError: there is no space for it; what was held before is still held.
        """
        if size <= self._reserved:
            return
        if self.full:
            raise DiskFullError
        wanted = (size // _STEP + 1) * _STEP
        try:
            if self._reserve is None:
                self._reserve = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115
            _allocate(self._reserve, self._reserved, wanted - self._reserved)
        except OSError as error:
            if not _is_full(error):
                raise
            raise DiskFullError from error
        self._reserved = wanted

    def release(self) -> None:
        """Give the reserve back to the disk."""
        if self._reserve is not None:
            self._reserve.close()
            self._reserve = None
        self._reserved = 0

    def write(self, data: bytes) -> int:
        """All of `data`, if need be at the expense of the reserve.

        Raises:
            DiskFullError: not even the reserve was enough; the file ends where it ended before.
            OSError: it cannot be written; where that is still possible, the file ends likewise.
        """
        start = self._position
        view = memoryview(data)
        while view:
            try:
                written = self._raw.write(view) or 0
            except OSError as error:
                if not _is_full(error):
                    with suppress(OSError):
                        self._raw.truncate(start)
                    self._position = start
                    raise
                if self.full:
                    self._raw.truncate(start)
                    self._position = start
                    raise DiskFullError from error
                self.full = True
                self.release()
                continue
            view = view[written:]
            self._position += written
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Nothing to do: nothing is buffered here."""

    def sync(self) -> None:
        """Wait until what was written is on the disk; from any thread.

        Raises:
            OSError: it could not be put there.
        """
        fileno = getattr(self._raw, "fileno", None)
        if fileno is not None:
            fdatasync(fileno())

    def is_at(self, path: Path) -> bool:
        """Whether `path` still is this file: nobody removed, moved or replaced it."""
        fileno = getattr(self._raw, "fileno", None)
        if fileno is None:
            return True
        try:
            return os.path.samestat(os.stat(path), os.fstat(fileno()))
        except OSError:
            return False

    def close(self) -> None:
        self.release()
        self._raw.close()


def sync_folder(folder: Path) -> None:
    """Wait until the names in `folder` are on the disk, where the system can do that."""
    with suppress(OSError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _allocate(file: BinaryIO, start: int, size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), start, size)
        return
    file.seek(start)
    for _ in range(size // _STEP):
        file.write(bytes(_STEP))
    file.flush()


def _is_full(error: OSError) -> bool:
    return error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
