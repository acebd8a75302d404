"""From a source into a log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from recorder.attachments import check_image_size, merge_attachments
from recorder.capture.disk import DiskGuard
from recorder.capture.frame_queue import MAX_BYTES, MAX_FRAMES
from recorder.capture.memory import keep_freed_memory
from recorder.capture.notes import Notes
from recorder.capture.outages import Outages
from recorder.capture.parts import PartsWriter, SplitLimit, recording_id
from recorder.capture.recording import Recording, Status, Stop
from recorder.capture.sink_thread import FrameSink
from recorder.capture.source_thread import is_live
from recorder.errors import InputError
from recorder.interrupts import stop_requests
from recorder.log import ending, topics
from recorder.log.counts import FrameCounts
from recorder.log.target import DisplacedError
from recorder.log.writer import LogWriter
from recorder.session import session_metadata
from recorder.sources.base import CapturedFrame, LiveSource, Source

__all__ = ["FrameSink", "Notes", "RecordSummary", "Status", "record"]


@dataclass(frozen=True)
class RecordSummary:
    """What a recording left.

    Attributes:
        path: the log, or the first part; it is there unless no frame was written.
        parts: all logs of the recording.
        problem: for `failed`, what stopped it; the log has all that came before.
        counts: of the frames, in all parts.
        display_dropped: frames that viewers missed.
        outages: of a live source.
        duration_s: from the first to the last capture.
        missing: `camera.yaml` and `map.yaml`, where the log has none.
    """

    path: Path
    parts: tuple[Path, ...]
    ended: Stop
    problem: str | None
    counts: FrameCounts
    display_dropped: int
    outages: Outages
    duration_s: float
    bytes_written: int
    missing: tuple[str, ...]

    @property
    def frames_written(self) -> int:
        return self.counts.written

    @property
    def frames_dropped(self) -> int:
        return self.counts.dropped


def record(
    source: Source | LiveSource,
    out: Path,
    *,
    attachments: Mapping[str, bytes] | None = None,
    session: Mapping[str, str] | None = None,
    force: bool = False,
    sinks: Iterable[FrameSink] = (),
    duration_s: float | None = None,
    split: SplitLimit | None = None,
    min_free_bytes: int = 0,
    notes: Notes | None = None,
    on_status: Callable[[Status], None] | None = None,
    on_written: Callable[[CapturedFrame], None] | None = None,
    display_missed: Callable[[], int] | None = None,
) -> RecordSummary:
    """Write every frame of `source` into the log `out`.

    Taking frames, writing and each sink run in threads of their own, so that none holds up what
    must not wait; of a source that waits, nothing is ever dropped, and its log is always the same.
    Ctrl-C, a request to terminate, a lost terminal and a disk that fills up stop the recording; the
    log is finished and kept, unless not one frame is in it.

    Args:
        attachments: `camera.yaml`, `map.yaml`, `truth.*` in place of those the source brings.
        session: entries of the session metadata, such as `host`, in place of what is found here.
        force: replace `out` if it exists.
        sinks: called with frames that are in the log, the newest first; a sink that is too slow for
            a live source misses some, and one that raises is not called again.
        duration_s: stop so long after the first frame.
        split: parts `out`-001, `out`-002, ... of this size.
        min_free_bytes: stop before there is less space on the disk.
        notes: events of others, written as they come.
        on_status: called ten times a second, from this thread.
        on_written: called with every frame that is in the log, in its order, from the thread that
            writes it: it must return at once.
        display_missed: frames that were not shown, by who shows what `on_written` is called with.

    Raises:
        InputError: the source or a file is not what was expected; no log is left behind, unless it
            holds frames of a live source.
    """
    live = is_live(source)
    files = merge_attachments(source.attachments, attachments or {})
    if topics.CAMERA_FILE in files:
        check_image_size(files[topics.CAMERA_FILE], source.image_size, source.name)
    told = {**session_metadata(source), **(session or {})}
    if live:
        queue = f"{MAX_FRAMES} frames, {MAX_BYTES >> 20} MiB"
        keep_freed_memory()
        told = {topics.LIVE: "yes", topics.QUEUE: queue, **told}
    guard = DiskGuard(out.parent, min_free_bytes)
    guard.check_start(out)
    recording = Recording(
        source,
        sinks=tuple(sinks),
        duration_s=duration_s,
        notes=notes,
        on_written=on_written,
        display_missed=display_missed,
    )

    def open_part(path: Path, more: Mapping[str, str], before: LogWriter | None) -> LogWriter:
        return LogWriter(
            path,
            attachments=files,
            session={**told, **more},
            force=force and split is None,
            live=live,
            continues=before,
        )

    writer = PartsWriter(
        out,
        open_part,
        limit=split,
        recording=recording_id(told, files, live) if split else "",
        display_dropped=lambda: recording.display_dropped,
        live=live,
    )
    # A second Ctrl-C does not come between the last frame and the end of the log.
    with stop_requests() as request:
        try:
            ended, error = recording.run(writer, guard, request, on_status)
        except BaseException as mistake:
            writer.end_as(ending.after(mistake))
            writer.close()
            raise
        problem = None
        more = recording.outages.as_metadata() if live else {}
        try:
            if error is not None:
                problem = _give_up(writer, error, more, live=live)
            elif not writer.counts.written:
                writer.discard()
                if ended == "complete":
                    raise InputError(source.name, "expected images, found none that can be read")
            else:
                writer.end_as(ended, **more)
                writer.close()
        except DisplacedError as failure:
            ended, problem = "failed", str(failure)
        except OSError as failure:
            ended, problem = "failed", _write_problem(writer, failure)
    return RecordSummary(
        path=writer.paths[0],
        parts=tuple(writer.paths),
        ended=ended,
        problem=problem,
        counts=writer.counts,
        display_dropped=recording.display_dropped,
        outages=recording.outages,
        duration_s=writer.duration_s,
        bytes_written=writer.bytes_written,
        missing=tuple(n for n in (topics.CAMERA_FILE, topics.MAP_FILE) if n not in files),
    )


def _give_up(
    writer: PartsWriter, error: BaseException, more: Mapping[str, str], *, live: bool
) -> str:
    """Ends a recording that failed; returns why.

    What can be had again from its source is not left half; what cannot is kept.
    """
    if not writer.counts.written or (isinstance(error, InputError) and not live):
        writer.discard()
        raise error
    writer.end_as(ending.after(error), **more)
    if isinstance(error, OSError):
        with suppress(OSError):
            writer.close()
        return _write_problem(writer, error)
    writer.close()
    if not isinstance(error, InputError):
        raise error
    return str(error)


def _write_problem(writer: PartsWriter, error: OSError) -> str:
    reason = (error.strerror or str(error)).lower()
    return (
        f"{writer.log.written_to}: expected to go on writing, found: {reason}; what is in it can "
        "be read, and `arucolog recover` gives it its end"
    )
