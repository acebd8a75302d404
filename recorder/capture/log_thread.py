"""Writes what was captured, and hands it to those who watch."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from recorder.capture.disk import DiskGuard, SyncThread
from recorder.capture.frame_queue import FrameQueue
from recorder.capture.inspection import InspectionThread
from recorder.capture.notes import Notes
from recorder.capture.outages import OutageClock
from recorder.capture.parts import PartsWriter
from recorder.capture.sink_thread import SinkThread
from recorder.errors import InputError
from recorder.sources.base import CapturedFrame, SourceEvent

# A kill costs what is in the open chunk, a power loss what is not synced. Both are asked for by the
# clock, also while nothing arrives. A slow disk takes a few tenths to sync: with them, and with the
# look around, a loss stays below a second.
_FLUSH_S = 0.4
_SYNC_S = 0.5
_LOOK_S = 0.1


class LogThread(threading.Thread):
    """Empties `queue` into `writer`, frame by frame, until the queue has ended.

    Attributes:
        outages: of the source.
        error: what stopped it.
        disk_is_low: there is little space left; it goes on until the queue has ended.
    """

    def __init__(
        self,
        queue: FrameQueue,
        writer: PartsWriter,
        *,
        sinks: Sequence[SinkThread],
        guard: DiskGuard,
        sync: SyncThread | None,
        inspection: InspectionThread | None,
        notes: Notes | None,
        on_written: Callable[[CapturedFrame], None] | None = None,
    ) -> None:
        """`sync`, `inspection`: for frames that come only once. Without the first, chunks close by
        log time alone."""
        super().__init__(name="log", daemon=True)
        self._queue = queue
        self._writer = writer
        self._sinks = sinks
        self._guard = guard
        self._sync = sync
        self._inspection = inspection
        self._notes = notes
        self._on_written = on_written
        self._told: set[SinkThread] = set()
        self._taken = 0
        self._flushed_at = self._synced_at = self._looked_at = time.monotonic()
        self.outages = OutageClock()
        self.error: BaseException | None = None
        self.disk_is_low = False

    def run(self) -> None:
        try:
            while not self._queue.ended:
                self._write_next()
                self._look_around()
            if self._inspection is not None:
                self._inspection.close()
            self._write_notes()
        except BaseException as error:
            self.error = error
            lost = self._queue.give_up() + self._taken - self._writer.counts.written
            self._writer.log.announce_dropped(lost if self._sync else 0)

    def _write_next(self) -> None:
        item = self._queue.get(_LOOK_S)
        if item is None:
            return
        if isinstance(item, SourceEvent):
            if item.connected is not None:
                self.outages.tell(connected=item.connected, silent_s=item.silent_s)
            self._writer.log.write_event(
                item.timestamp_ns, item.level, item.message, dropped=item.dropped
            )
            return
        self._taken += 1
        if self._sync is not None and not self._writer.log.has_open_chunk:
            self._flushed_at = time.monotonic()
        fault = self._writer.write_frame(item)
        # Images in other formats were compressed here.
        if self._inspection is not None and fault is None and item.format == "jpeg":
            self._inspection.offer(item)
        if self._on_written is not None:
            self._on_written(item)
        for sink in self._sinks:
            sink.offer(item)

    def _look_around(self) -> None:
        self.disk_is_low |= self._guard.is_low(self._writer.bytes_written)
        now = time.monotonic()
        if self._sync is not None:
            synced_long_ago = now - self._synced_at >= _SYNC_S
            if synced_long_ago or now - self._flushed_at >= _FLUSH_S:
                self._writer.log.flush()
                self._flushed_at = now
            if synced_long_ago:
                self._sync.ask()
                self._synced_at = now
            if self._sync.error is not None:
                raise self._sync.error
            for text in self._sync.slow():
                timestamp_ns, arrival_ns = self._writer.log.last_stamps
                self._writer.log.write_event(timestamp_ns, "warning", text, arrival_ns=arrival_ns)
        if now - self._looked_at < _LOOK_S:
            return
        self._looked_at = now
        self._write_notes()
        if not self._writer.log.is_in_place:
            raise InputError(
                self._writer.log.written_to,
                "expected the log that is being recorded, found that it was removed or replaced",
            )

    def _write_notes(self) -> None:
        log = self._writer.log
        for note in self._notes.take() if self._notes is not None else ():
            log.write_event(
                note.timestamp_ns,
                note.level,
                note.message,
                name=note.name,
                arrival_ns=note.arrival_ns,
            )
        inspection = self._inspection
        for found in inspection.take() if inspection is not None else ():
            log.count_inspected(*found)
        if inspection is not None and inspection.error is not None:
            self._inspection = None
            timestamp_ns, arrival_ns = log.last_stamps
            reason = str(inspection.error) or type(inspection.error).__name__
            text = f"images are not looked into any more: {reason}"
            log.write_event(timestamp_ns, "warning", text, arrival_ns=arrival_ns)
        for sink in self._sinks:
            if sink.error is not None and sink not in self._told:
                self._told.add(sink)
                timestamp_ns, arrival_ns = log.last_stamps
                reason = str(sink.error) or type(sink.error).__name__
                text = f"a viewer failed and shows nothing any more: {reason}"
                log.write_event(timestamp_ns, "warning", text, arrival_ns=arrival_ns)
