"""From a source into a log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from recorder.attachments import check_image_size, merge_attachments
from recorder.errors import InputError
from recorder.interrupts import termination_interrupts
from recorder.log import topics
from recorder.log.writer import DiskFullError, LogWriter
from recorder.session import session_metadata
from recorder.sources.base import CapturedFrame, Source, SourceEvent

FrameSink = Callable[[CapturedFrame], None]
Ending = Literal["complete", "interrupted", "disk_full"]


@dataclass(frozen=True)
class RecordSummary:
    """What a recording left.

    Attributes:
        path: the log; it is there unless no frame was written.
        duration_s: from the first to the last capture.
        missing: `camera.yaml` and `map.yaml`, where the log has none.
    """

    path: Path
    ended: Ending
    frames_written: int
    frames_dropped: int
    duration_s: float
    bytes_written: int
    missing: tuple[str, ...]


def record(
    source: Source,
    out: Path,
    *,
    attachments: Mapping[str, bytes] | None = None,
    session: Mapping[str, str] | None = None,
    force: bool = False,
    sinks: Iterable[FrameSink] = (),
) -> RecordSummary:
    """Write every frame of `source` into the log `out`.

    Ctrl-C, a request to terminate and a full disk stop the recording; the log is finished and
    kept, unless not one frame is in it.

    Args:
        attachments: `camera.yaml`, `map.yaml`, `truth.*` in place of those the source brings.
        session: entries of the session metadata, such as `host`, in place of what is found here.
        force: replace `out` if it exists.
        sinks: called with each frame once it is in the log: a viewer, a progress bar.

    Raises:
        InputError: the source or a file is not what was expected; no log is left behind.
    """
    files = merge_attachments(source.attachments, attachments or {})
    if topics.CAMERA_FILE in files:
        check_image_size(files[topics.CAMERA_FILE], source.image_size, source.name)
    told = {**session_metadata(source), **(session or {})}
    sinks = tuple(sinks)
    ended: Ending = "complete"
    first_ns = last_ns = 0
    with ExitStack() as stack:
        stack.enter_context(termination_interrupts())
        writer = stack.enter_context(LogWriter(out, attachments=files, session=told, force=force))
        frames = source.frames()
        if close := getattr(frames, "close", None):
            stack.callback(close)
        try:
            for item in frames:
                if isinstance(item, SourceEvent):
                    writer.write_event(
                        item.timestamp_ns, item.level, item.message, dropped=item.dropped
                    )
                    continue
                writer.write_frame(item)
                first_ns = item.timestamp_ns if writer.frames_written == 1 else first_ns
                last_ns = item.timestamp_ns
                for sink in sinks:
                    sink(item)
        except KeyboardInterrupt:
            ended = "interrupted"
        except DiskFullError:
            ended = "disk_full"
        except InputError:
            writer.discard()
            raise
        writer.end_as(ended)
        if not writer.frames_written:
            writer.discard()
            if ended == "complete":
                raise InputError(source.name, "expected images, found none that can be read")
    return RecordSummary(
        path=out,
        ended=ended,
        frames_written=writer.frames_written,
        frames_dropped=writer.frames_dropped,
        duration_s=(last_ns - first_ns) / 1e9,
        bytes_written=writer.bytes_written,
        missing=tuple(n for n in (topics.CAMERA_FILE, topics.MAP_FILE) if n not in files),
    )
