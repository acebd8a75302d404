"""A Rerun recording that gets its name only when it is whole."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import rerun as rr
from rerun.chunk import Chunk, RrdReader

from replay.viewer import style

# Images and events wait until they are so many, then they are one chunk; a file lists every chunk.
_CHUNK_BYTES = 4 << 20


class RecordingFile:
    """A stream into PATH.part, renamed to PATH by `close`."""

    def __init__(self, path: Path, recording_id: str, name: str) -> None:
        self._path = path
        self._part = path.with_name(f"{path.name}.part")
        # By size alone: with the clock's help, chunks are small where the work is slow.
        batches = rr.ChunkBatcherConfig.NEVER()
        batches.flush_num_bytes = _CHUNK_BYTES
        self.stream = rr.RecordingStream(
            style.APPLICATION_ID, recording_id=recording_id, batcher_config=batches
        )
        self.stream.save(self._part)
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self.stream.send_recording_name(name)

    def copy(self, chunks: Iterable[Chunk]) -> None:
        """Takes over what another recording holds, with one chunk in memory at a time."""
        for chunk in chunks:
            self.stream.send_chunks(chunk)
            # It would take them as fast as they are read and keep them until the disk has them.
            self.stream.flush()

    def close(self) -> None:
        """
        Raises:
            OSError: the file is not whole, as on a full disk.
        """
        try:
            self.stream.flush()
            self.stream.disconnect()
            # A failed write is only logged; without its footer a file lists nothing.
            whole = bool(RrdReader(self._part).recordings())
        except (RuntimeError, ValueError, OSError) as error:
            self.discard()
            raise OSError(f"{self._path}: could not be written: {error}") from error
        if not whole:
            self.discard()
            raise OSError(f"{self._path}: could not be written; is the disk full?")
        os.replace(self._part, self._path)

    def discard(self) -> None:
        """Leaves nothing behind."""
        self.stream.disconnect()
        self._part.unlink(missing_ok=True)
