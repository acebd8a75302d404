"""A recording as one log, or as several that follow one another."""

from __future__ import annotations

import hashlib
import json
import threading
import time
import uuid
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from recorder.errors import InputError
from recorder.log import ending, topics
from recorder.log.counts import FrameCounts
from recorder.log.parts import part_path
from recorder.log.writer import LogWriter
from recorder.quantities import parse_duration, parse_size
from recorder.sources.base import CapturedFrame

OpenPart = Callable[[Path, Mapping[str, str], LogWriter | None], LogWriter]


@dataclass(frozen=True)
class SplitLimit:
    """When a part is full; what is None does not matter."""

    bytes: int | None = None
    seconds: float | None = None

    @classmethod
    def parse(cls, text: str) -> SplitLimit:
        """From a size (`1GB`) or a duration (`10min`).

        Raises:
            ValueError: neither of them, or below 1 MB.
        """
        with suppress(ValueError):
            return cls(seconds=parse_duration(text))
        with suppress(ValueError):
            if (size := parse_size(text)) >= 10**6:
                return cls(bytes=size)
        raise ValueError(f"expected a size from 1MB or a duration such as 10min, found {text!r}")


class PartsWriter:
    """Writes a recording; with a limit, into as many logs as it takes.

    A part ends before the frame that would take it over its limit. Each has all attachments, the
    session and the topics for viewers; frame numbers go on.

    Attributes:
        paths: of the logs so far, the last one being written; once that is closed, of where it is:
            one that could not take the place of another is beside it.
    """

    def __init__(
        self,
        path: Path,
        open_part: OpenPart,
        *,
        limit: SplitLimit | None = None,
        recording: str = "",
        display_dropped: Callable[[], int] = lambda: 0,
        live: bool = False,
    ) -> None:
        """Opens the first log.

        Args:
            path: of the log; of parts, without their number.
            open_part: opens a log, given its path, what goes into its session beside the usual,
                and the part before it.
            recording: what all parts have in common, and no other recording has.
            display_dropped: frames that were not shown so far.
            live: a part also ends by a clock that nobody sets back, not by arrivals alone.

        Raises:
            InputError: a log cannot be made.
        """
        self._path = path
        self._open_part = open_part
        self._limit = limit
        self._recording = recording
        self._display_dropped = display_dropped
        self._live = live
        self._shown_missing = 0
        self._earlier = FrameCounts()
        self._earlier_bytes = 0
        self._start_ns: int | None = None
        self._part_start_ns: int | None = None
        self._part_begun_ns = 0
        # The log that is being written is not closed while another thread waits for the disk.
        self._closing = threading.Lock()
        self.paths: list[Path] = []
        if limit is not None:
            _refuse_existing(path)
        self._log = self._open(None)

    @property
    def counts(self) -> FrameCounts:
        """Of all parts together."""
        return self._earlier + self._log.counts

    @property
    def bytes_written(self) -> int:
        """Of all parts together."""
        return self._earlier_bytes + self._log.bytes_written

    @property
    def duration_s(self) -> float:
        """From the first frame's capture to the last one's; no jump back counts."""
        return self.log.passed_ns / 1e9

    @property
    def log(self) -> LogWriter:
        """The log that is being written."""
        return self._log

    def write_frame(self, frame: CapturedFrame) -> str | None:
        """As `LogWriter.write_frame`, in the next part if this one is full."""
        if self._is_full(frame):
            self._next()
        fault = self._log.write_frame(frame)
        if self._start_ns is None:
            self._start_ns = frame.timestamp_ns
        if self._part_start_ns is None:
            self._part_start_ns, self._part_begun_ns = frame.arrival_ns, time.monotonic_ns()
        return fault

    def sync(self) -> None:
        """As `LogWriter.sync`, from any thread."""
        with self._closing:
            self._log.sync()

    def end_as(self, ended: str, **more: str) -> None:
        """How the last part ends."""
        missing = self._display_dropped() - self._shown_missing
        self._log.end_as(ended, display_dropped=str(missing), **more)

    def close(self) -> None:
        """Write the end of the last part."""
        try:
            with self._closing:
                self._log.close()
        finally:
            self.paths[-1] = self._log.written_to

    def discard(self) -> None:
        """Leave no file behind, of any part."""
        self._log.discard()
        self.close()
        for path in self.paths[:-1]:
            path.unlink(missing_ok=True)

    def _is_full(self, frame: CapturedFrame) -> bool:
        limit = self._limit
        if limit is None or self._part_start_ns is None:
            return False
        if limit.bytes is not None:
            return self._log.bytes_ahead + len(frame.data) + 1024 > limit.bytes
        passed_ns = frame.arrival_ns - self._part_start_ns
        if self._live:
            passed_ns = max(passed_ns, time.monotonic_ns() - self._part_begun_ns)
        return limit.seconds is not None and passed_ns >= limit.seconds * 1e9

    def _next(self) -> None:
        full = self._log
        # A disk that fails now finds a log that is not closed yet and can still tell.
        full.flush()
        if self._live:
            self.sync()
        try:
            following = self._open(full)
        except InputError as error:
            # Better one part that is too long than none.
            self._limit = None
            text = f"no further part can be made: {error}"
            full.write_event(full.last_stamps[0], "error", text, arrival_ns=full.last_stamps[1])
            return
        self.end_as(ending.split(following.path.name))
        self._shown_missing = self._display_dropped()
        with self._closing:
            try:
                full.close()
            except BaseException:
                self._take_back(following)
                raise
            self._earlier += full.counts
            self._earlier_bytes += full.bytes_written
            self._log = following
        self._part_start_ns = None

    def _take_back(self, part: LogWriter) -> None:
        """The recording ends in the part before."""
        self.paths.pop()
        part.discard()
        with suppress(OSError):
            part.close()

    def _open(self, before: LogWriter | None) -> LogWriter:
        if self._limit is None:
            self.paths.append(self._path)
            return self._open_part(self._path, {}, None)
        part = len(self.paths) + 1
        session = {topics.RECORDING: self._recording, topics.PART: str(part)}
        if self._start_ns is not None:
            session[topics.RECORDING_START] = str(self._start_ns)
        path = part_path(self._path, part)
        log = self._open_part(path, session, before)
        self.paths.append(path)
        return log


def recording_id(session: Mapping[str, str], attachments: Mapping[str, bytes], live: bool) -> str:
    """Of a live recording, like no other; of a file, the same whenever it is recorded so."""
    if live:
        return uuid.uuid4().hex
    digest = hashlib.sha256(json.dumps(dict(session), sort_keys=True).encode())
    for name, data in attachments.items():
        digest.update(name.encode() + b"\0" + hashlib.sha256(data).digest())
    return digest.hexdigest()[:32]


def _refuse_existing(path: Path) -> None:
    """Parts are never replaced: a shorter recording would leave parts of a longer one among its
    own."""
    for found in sorted(path.parent.glob(f"{path.stem}-*{path.suffix}")):
        if found.stem.removeprefix(f"{path.stem}-").isdecimal():
            raise InputError(
                path,
                f"expected a name whose parts do not exist, found {found.name} "
                "(--force replaces no parts: give another name, or remove them)",
            )
