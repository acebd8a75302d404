"""The records of an MCAP file in the order of the file, whole ones only.

mcap's own readers take a file without its end for damaged as a whole, or say no more than that it
ended; so the framing (opcode, length, CRC) is done here, as the MCAP specification has it, and the
records' contents are parsed by parts of mcap that it does not document: `mcap.records`,
`mcap.data_stream`, `mcap.stream_reader.breakup_chunk`. Any release of mcap may change them: the
version is held in pyproject.toml, and the tests of cut and damaged logs notice.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.stream_reader import CRCValidationError, breakup_chunk
from mcap.writer import MCAP0_MAGIC

_HEAD = struct.Struct("<BQ")
_FOOTER_SIZE = _HEAD.size + 20 + len(MCAP0_MAGIC)
# What a damaged or cut record can do to mcap's parsers.
_DAMAGE = (McapError, ValueError, struct.error, EOFError, MemoryError, RuntimeError)


class DamagedError(Exception):
    """The file cannot be read on from here; its text is the reason in a few words."""


def data_records(file: BinaryIO) -> Iterator[McapRecord]:
    """Attachments, metadata, schemas, channels and messages up to the end of the data section.

    Chunks are opened one at a time, their CRCs checked; `file` is just behind the magic.

    Raises:
        DamagedError: the file ends, or is not as it was written, before the data section does.
    """
    size = os.fstat(file.fileno()).st_size
    while True:
        opcode, body = _next_record(file, size)
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        try:
            if opcode == Opcode.CHUNK:
                yield from breakup_chunk(Chunk.read(_stream(body)), validate_crc=True)
                continue
            record = _parse(opcode, body)
        except CRCValidationError as error:
            raise DamagedError("a chunk's checksum is wrong") from error
        except _DAMAGE as error:
            raise DamagedError(f"unreadable data: {error}") from error
        if record is not None:
            yield record


def summary_records(file: BinaryIO) -> Iterator[McapRecord]:
    """Channels, statistics and, from all over the file, metadata; nothing if it has no good end."""
    size = os.fstat(file.fileno()).st_size
    if size < 2 * len(MCAP0_MAGIC) + _FOOTER_SIZE:
        return
    file.seek(size - _FOOTER_SIZE)
    tail = file.read(_FOOTER_SIZE)
    opcode, length = _HEAD.unpack_from(tail)
    if opcode != Opcode.FOOTER or length != 20 or not tail.endswith(MCAP0_MAGIC):
        return
    footer = Footer.read(_stream(tail[_HEAD.size :]))
    if not 0 < footer.summary_start < size - _FOOTER_SIZE:
        return
    file.seek(footer.summary_start)
    summary = file.read(size - _FOOTER_SIZE - footer.summary_start)
    # The CRC covers the footer up to itself.
    if footer.summary_crc not in (0, zlib.crc32(summary + tail[: _HEAD.size + 16])):
        return
    try:
        yield from _summary(file, summary, size)
    except (DamagedError, *_DAMAGE):
        return


def _summary(file: BinaryIO, summary: bytes, size: int) -> Iterator[McapRecord]:
    at = 0
    while at < len(summary):
        opcode, length = _HEAD.unpack_from(summary, at)
        body = _stream(summary[at + _HEAD.size : at + _HEAD.size + length])
        at += _HEAD.size + length
        if opcode == Opcode.CHANNEL:
            yield Channel.read(body)
        elif opcode == Opcode.STATISTICS:
            yield Statistics.read(body)
        elif opcode == Opcode.METADATA_INDEX:
            file.seek(MetadataIndex.read(body).offset)
            found, content = _next_record(file, size)
            if found == Opcode.METADATA:
                yield Metadata.read(_stream(content))


def _next_record(file: BinaryIO, size: int) -> tuple[int, bytes]:
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        raise DamagedError("the file ends early")
    opcode, length = _HEAD.unpack(head)
    if opcode == 0:
        raise DamagedError("zeros instead of data")
    if length > size - file.tell():
        raise DamagedError("the file ends early")
    return opcode, file.read(length)


def _parse(opcode: int, body: bytes) -> McapRecord | None:
    record: McapRecord | None = None
    if opcode == Opcode.ATTACHMENT:
        (crc,) = struct.unpack("<I", body[-4:])
        if crc not in (0, zlib.crc32(body[:-4])):
            raise DamagedError("an attachment's checksum is wrong")
        record = Attachment.read(_stream(body))
    elif opcode == Opcode.METADATA:
        record = Metadata.read(_stream(body))
    elif opcode == Opcode.SCHEMA:
        record = Schema.read(_stream(body))
    elif opcode == Opcode.CHANNEL:
        record = Channel.read(_stream(body))
    elif opcode == Opcode.MESSAGE:
        record = Message.read(_stream(body), len(body))
    return record


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))
