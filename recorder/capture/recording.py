"""One recording from its first frame to its last: who does what, and when it ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from recorder.capture.disk import DiskGuard, SyncThread
from recorder.capture.frame_queue import FrameQueue
from recorder.capture.inspection import InspectionThread
from recorder.capture.log_thread import LogThread
from recorder.capture.notes import Notes
from recorder.capture.outages import Outages
from recorder.capture.parts import PartsWriter
from recorder.capture.sink_thread import FrameSink, SinkThread
from recorder.capture.source_thread import SourceThread, is_live
from recorder.interrupts import StopRequest
from recorder.log.counts import FrameCounts
from recorder.log.writer import DiskFullError
from recorder.sources.base import CapturedFrame, LiveSource, Source

# How often it looks whether to stop, and how long a source may take to do so.
_LOOK_S = 0.1
_STOP_S = 2.0

Stop = Literal["complete", "interrupted", "disk_low", "disk_full", "failed"]


@dataclass(frozen=True)
class Status:
    """How a recording stands.

    Attributes:
        counts: of the frames in the log; dropped ones also where the log does not tell of them yet.
        display_dropped: frames that viewers missed.
        queued_frames: frames that wait to be written; `queued_bytes` are theirs.
        free_bytes: on the disk.
        lost_s: for how long the connection has been lost; None where it is not.
        told: the warnings and errors since the status before.
    """

    counts: FrameCounts
    display_dropped: int
    queued_frames: int
    queued_bytes: int
    bytes_written: int
    free_bytes: int
    told: tuple[str, ...] = ()
    lost_s: float | None = None


class Recording:
    """Runs a source in one thread, the log in a second, each viewer in one of its own.

    The thread that calls `run` watches, and alone is told to stop.

    Attributes:
        outages: of the source, once `run` has ended.
    """

    def __init__(
        self,
        source: Source | LiveSource,
        *,
        sinks: Sequence[FrameSink],
        duration_s: float | None,
        notes: Notes | None,
        on_written: Callable[[CapturedFrame], None] | None = None,
        display_missed: Callable[[], int] | None = None,
    ) -> None:
        self._live = is_live(source)
        self._duration_s = duration_s
        self._notes = notes
        self._on_written = on_written
        self._display_missed = display_missed
        self._source = source
        self._queue = FrameQueue(waits=not self._live)
        self._sinks = [SinkThread(sink, waits=not self._live) for sink in sinks]
        self._stopping = False
        self.outages = Outages()

    @property
    def display_dropped(self) -> int:
        others = self._display_missed() if self._display_missed is not None else 0
        return sum(sink.dropped for sink in self._sinks) + others

    def run(
        self,
        writer: PartsWriter,
        guard: DiskGuard,
        request: StopRequest,
        on_status: Callable[[Status], None] | None = None,
    ) -> tuple[Stop, BaseException | None]:
        """Records until the end, or until `request` is made; `writer` is left open.

        Returns:
            Why it ended; for `failed` the error.
        """
        sync = SyncThread(writer.sync) if self._live else None
        inspection = InspectionThread() if self._live else None
        log = LogThread(
            self._queue,
            writer,
            sinks=self._sinks,
            guard=guard,
            sync=sync,
            inspection=inspection,
            notes=self._notes,
            on_written=self._on_written,
        )
        source = SourceThread(
            self._source,
            self._queue,
            should_stop=lambda: self._stopping or request.made,
            duration_s=self._duration_s,
        )

        def tell() -> None:
            if on_status is not None:
                on_status(self._status(writer, guard, log.outages.lasts_s))

        for thread in (sync, inspection, *self._sinks, log, source):
            if thread is not None:
                thread.start()
        try:
            stop = self._watch(request, source, log, tell)
        finally:
            # Also when the status cannot be shown: whoever closes the log is alone with it.
            self._stopping = True
            source.stop()
            self._queue.close()
            for sink in self._sinks:
                sink.close(_STOP_S)
            log.join()
            self.outages = log.outages.outages
            if inspection is not None:
                inspection.close()
            if sync is not None:
                sync.close()
        tell()
        if log.error is not None:
            return ("disk_full", None) if _is_full(log.error) else ("failed", log.error)
        if isinstance(source.error, KeyboardInterrupt):
            return "interrupted", None
        return ("failed", source.error) if source.error is not None else (stop, None)

    def _watch(
        self, request: StopRequest, source: SourceThread, log: LogThread, tell: Callable[[], None]
    ) -> Stop:
        stop: Stop | None = None
        stopped_at = 0.0
        while True:
            log.join(_LOOK_S)
            if stop is None and request.made:
                stop = "interrupted"
            elif stop is None and log.disk_is_low and log.is_alive() and source.is_alive():
                # Of a source that has ended everything is written.
                stop = "disk_low"
            elif stop is None and source.is_over_time():
                stop = "complete"
            if not self._stopping and (stop is not None or not log.is_alive()):
                self._stopping = True
                stopped_at = time.monotonic()
                source.stop()
            if not log.is_alive():
                source.join(max(stopped_at + _STOP_S - time.monotonic(), 0))
                return stop or "complete"
            if stop is not None and time.monotonic() - stopped_at > _STOP_S:
                # It does not listen. What it gave is written; what it may give is not waited for,
                # nor is a viewer.
                self._queue.close()
                for sink in self._sinks:
                    sink.close(0)
            tell()

    def _status(self, writer: PartsWriter, guard: DiskGuard, lost_s: float | None) -> Status:
        untold = self._queue.lost_frames + writer.log.announced_dropped
        return Status(
            counts=writer.counts + FrameCounts(dropped=untold),
            display_dropped=self.display_dropped,
            queued_frames=self._queue.frames,
            queued_bytes=self._queue.bytes,
            bytes_written=writer.bytes_written,
            free_bytes=guard.free_bytes,
            told=writer.log.take_told(),
            lost_s=lost_s,
        )


def _is_full(error: BaseException) -> bool:
    return isinstance(error, DiskFullError)
