"""The Rerun file of a tracked recording, once its log is whole."""

from __future__ import annotations

from pathlib import Path

from rerun.chunk import RrdReader

from recorder.log.reader import LogReader
from recorder.log.records import LogEvent, LogImage
from replay.viewer.events import LogEvents
from replay.viewer.layout import results_layout
from replay.viewer.output import RecordingFile
from replay.viewer.overlay import ResultRecording, read_layout


def complete_rrd(rrd: Path, result_name: str, reader: LogReader, log_id: str) -> None:
    """Gives a file that was made while its log was what only the whole log tells.

    That is the log's identity, under which the viewer lays results over each other, and its events.

    Raises:
        NotWrittenError: there is no room for it; no file is left.
    """
    raw = rrd.with_suffix(".raw.rrd")
    rrd.rename(raw)
    try:
        file = RecordingFile(rrd, log_id, reader.path.stem)
        try:
            file.copy(RrdReader(raw).stream())
            _log_events(file, reader)
            layout = read_layout(ResultRecording(raw, result_name, result_name))
            file.stream.send_blueprint(results_layout([layout]))
        except BaseException:
            file.discard()
            raise
        file.close()
    finally:
        raw.unlink()


def _log_events(file: RecordingFile, reader: LogReader) -> None:
    events = LogEvents(file.stream, reader.start_ns or 0)
    for record in reader.records():
        if isinstance(record, LogImage):
            events.frame(record.timestamp_ns, record.frame_index)
        elif isinstance(record, LogEvent):
            events.add(record)
    events.flush()
