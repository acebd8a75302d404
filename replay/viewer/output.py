"""A Rerun recording that gets its name only when it is whole."""

from __future__ import annotations

import errno
import os
import sys
import threading
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import rerun as rr
from rerun.chunk import Chunk, RrdReader

from replay.viewer import style

# Images and events wait until they are so many, then they are one chunk; a file lists every chunk.
_CHUNK_BYTES = 4 << 20
_PIPE_BYTES = 1 << 20
# Left free for the tables, which are written meanwhile and are worth more.
_RESERVE_BYTES = 2 << 20
_FLUSH_S = 0.5


class NotWrittenError(OSError):
    """A recording is not whole, as on a full disk; nothing is left of it.

    Attributes:
        reason: why, without the file's name.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: could not be written: {reason}")
        self.reason = reason


class RecordingFile:
    """A stream into PATH.part, renamed to PATH by `close`.

    What no disk takes is not written, and the space of what was is given back at once.
    """

    def __init__(self, path: Path, recording_id: str, name: str) -> None:
        self._path = path
        self._part = path.with_name(f"{path.name}.part")
        # By size alone: with the clock's help, chunks are small where the work is slow.
        batches = rr.ChunkBatcherConfig.NEVER()
        batches.flush_num_bytes = _CHUNK_BYTES
        self.stream = rr.RecordingStream(
            style.APPLICATION_ID, recording_id=recording_id, batcher_config=batches
        )
        self._writer = _Writer(self._part)
        self._writer.take(self.stream)
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self.stream.send_recording_name(name)

    def copy(self, chunks: Iterable[Chunk]) -> None:
        """Takes over what another recording holds, with one chunk in memory at a time.

        Raises:
            NotWrittenError: the disk is full.
        """
        for chunk in chunks:
            self.stream.send_chunks(chunk)
            # It would take them as fast as they are read and keep them until the disk has them.
            self._flush()
            if self._writer.error is not None:
                raise NotWrittenError(self._path, _reason(self._writer.error))

    def close(self) -> None:
        """
        Raises:
            NotWrittenError: the file is not whole, as on a full disk.
        """
        try:
            self._flush()
            self.stream.disconnect()
            self._writer.end()
            if self._writer.error is not None:
                raise self._writer.error
            # Without its footer a file lists nothing.
            whole = bool(RrdReader(self._part).recordings())
        except (RuntimeError, ValueError, OSError) as error:
            self.discard()
            raise NotWrittenError(self._path, _reason(error)) from error
        except BaseException:
            self.discard()
            raise
        if not whole:
            self.discard()
            raise NotWrittenError(self._path, "it lists no recording")
        os.replace(self._part, self._path)

    def discard(self) -> None:
        """Leaves nothing behind."""
        self._writer.give_up()
        self.stream.disconnect()
        self._writer.end()
        self._part.unlink(missing_ok=True)

    def _flush(self) -> None:
        """Waits for a slow disk as long as it takes, but not deaf to Ctrl-C."""
        while True:
            try:
                self.stream.flush(timeout_sec=_FLUSH_S)
            except RuntimeError as error:
                if "timed out" not in str(error):
                    raise
            else:
                return


class _Writer(threading.Thread):
    """Puts a stream into a file, through a pipe.

    After a failed write of its own, Rerun waits for ever, in `flush` as in `disconnect`. A pipe
    takes everything.

    Attributes:
        error: why the file is not whole.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(name="rrd", daemon=True)
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._given_up = False
        self.error: OSError | None = None

    def take(self, stream: rr.RecordingStream) -> None:
        """Starts with what `stream` is given from now on."""
        if not Path("/dev/fd").exists():
            # Windows: Rerun writes by itself.
            self._file.close()
            stream.save(str(self._path))
            return
        self._source, sink = os.pipe()
        try:
            if sys.platform == "linux":
                import fcntl

                with suppress(OSError):  # only faster
                    fcntl.fcntl(sink, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
            stream.save(f"/dev/fd/{sink}")
        finally:
            os.close(sink)
        self.start()

    def end(self) -> None:
        """Waits until all is written, once the stream has ended."""
        if self.ident is not None:
            self.join()

    def give_up(self) -> None:
        """Nothing more need be written."""
        self._given_up = True

    def run(self) -> None:
        try:
            while data := os.read(self._source, _PIPE_BYTES):
                if self._given_up:
                    continue
                try:
                    self._write(data)
                except OSError as error:
                    self._fail(error)
            self._file.close()
        except OSError as error:
            self._fail(error)
        finally:
            os.close(self._source)

    def _fail(self, error: OSError) -> None:
        self.error = self.error or error
        self._given_up = True
        # Whoever else writes to this disk has use for the space now.
        with suppress(OSError, ValueError):
            self._file.truncate(0)

    def _write(self, data: bytes) -> None:
        disk = os.fstatvfs(self._file.fileno())
        # Some file systems do not tell.
        if disk.f_blocks and disk.f_bavail * disk.f_frsize < len(data) + _RESERVE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]


def _reason(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
