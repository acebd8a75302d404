"""A copy of a log with other files attached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from recorder.attachments import check_image_size, merge_attachments
from recorder.errors import InputError
from recorder.image_header import read_header
from recorder.log import topics
from recorder.log.reader import LogReader
from recorder.log.records import LogImage
from recorder.log.writer import DiskFullError, LogWriter

# Of the last record, what the copy itself tells.
_MADE_ANEW = {"ended", "frames_written", "events"}


def attach(log: Path, out: Path, given: Mapping[str, bytes], *, force: bool = False) -> None:
    """Copy `log` to `out` with the `given` attachments in place of those of these names.

    Images, their stamps and every other message stay as they are; the topics that show the
    attachments to viewers are made anew. `out` may be `log` itself with `force`.

    Raises:
        InputError: not a log, a calibration for another image size, or no space.
    """
    with LogReader(log) as reader:
        attachments = merge_attachments(reader.attachments, given)
        _check_size(reader, given)
        own = topics.SESSION in reader.metadata
        shown = set[str]().union(*(topics.SHOWN_ON.get(name, ()) for name in given))
        left_out = topics.DERIVED if own else shown
        session = reader.metadata.get(topics.SESSION, {"source": log.name})
        try:
            with LogWriter(out, attachments=attachments, session=session, force=force) as writer:
                try:
                    for name, values in reader.other_metadata():
                        writer.add_metadata(name, values)
                    writer.add_metadata(
                        "attached", {"to_sha256": reader.sha256(), "files": ", ".join(given)}
                    )
                    images = 0
                    for schema, channel, message in reader.messages():
                        if channel.topic == topics.IMAGE:
                            # A log of another make may leave `sequence` at 0.
                            message = message if own else replace(message, sequence=images)
                            images += 1
                        if channel.topic not in left_out:
                            writer.copy(schema, channel, message)
                    # Only now: a log without its index has them at its end.
                    end = reader.metadata.get(topics.SESSION_END, {})
                    kept = {key: said for key, said in end.items() if key not in _MADE_ANEW}
                    writer.end_as(reader.ending, **kept)
                except BaseException:
                    writer.discard()
                    raise
        except DiskFullError as error:
            raise InputError(out, "expected space for a copy, found a full disk") from error


def _check_size(reader: LogReader, given: Mapping[str, bytes]) -> None:
    if topics.CAMERA_FILE not in given:
        return
    image = next((r for r in reader.records() if isinstance(r, LogImage)), None)
    header = read_header(image.data) if image is not None else None
    if header is not None:
        size = (header.width_px, header.height_px)
        check_image_size(given[topics.CAMERA_FILE], size, reader.path.name)
