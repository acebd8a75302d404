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
from collections.abc import Callable, Iterable, Iterator
from io import BytesIO
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
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

from recorder.log.damage import CHUNK_OVERHEAD, RECORD_HEAD, Damage, resume_at

_HEAD = RECORD_HEAD
_END_SIZES = {int(Opcode.DATA_END): 4, int(Opcode.FOOTER): 20}
# Opcodes from here on are for anyone's own records; below, the specification has no others.
_PRIVATE = 0x80
_BLOCK = 1 << 20
_FOOTER_SIZE = _HEAD.size + 20 + len(MCAP0_MAGIC)
# What a damaged or cut record can do to mcap's parsers.
_DAMAGE = (McapError, ValueError, struct.error, EOFError, MemoryError, RuntimeError)


class DamagedError(Exception):
    """The file cannot be read on from here; its text is the reason in a few words."""


def data_records(file: BinaryIO, on_damage: Callable[[Damage], None]) -> Iterator[McapRecord]:
    """Attachments, metadata, schemas, channels and messages up to the end of the data section.

    Chunks are opened one at a time, their CRCs checked; `file` is just behind the magic.

    Args:
        on_damage: called with each piece that is not as it was written, before what follows it.

    Raises:
        DamagedError: the file ends before the data section does.
    """
    size = os.fstat(file.fileno()).st_size
    while True:
        at = file.tell()
        try:
            opcode, body = _next_record(file, size)
            if _END_SIZES.get(opcode) == len(body):
                return
            records = _contents(opcode, body)
        except DamagedError as error:
            behind = resume_at(file, at, size)
            if behind is None:
                raise
            on_damage(Damage(at, behind - at, str(error)))
            file.seek(behind)
            continue
        yield from records


def _contents(opcode: int, body: bytes) -> Iterable[McapRecord]:
    if opcode in _END_SIZES or (opcode > max(Opcode) and opcode < _PRIVATE):
        raise DamagedError("unreadable data")
    try:
        if opcode == Opcode.CHUNK:
            chunk = Chunk.read(_stream(body))
            if len(body) != CHUNK_OVERHEAD + len(chunk.compression) + len(chunk.data):
                raise DamagedError("a chunk's length is wrong")
            return breakup_chunk(chunk, validate_crc=True)
        record = _parse(opcode, body)
    except CRCValidationError as error:
        raise DamagedError("a chunk's checksum is wrong") from error
    except _DAMAGE as error:
        raise DamagedError(f"unreadable data: {error}") from error
    return () if record is None else (record,)


def summary_records(file: BinaryIO) -> Iterator[McapRecord]:
    """Schemas, channels, statistics, chunk indices and, from all over the file, metadata.

    Nothing if the file has no good end.
    """
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
        if opcode == Opcode.SCHEMA:
            yield Schema.read(body)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(body)
        elif opcode == Opcode.STATISTICS:
            yield Statistics.read(body)
        elif opcode == Opcode.CHUNK_INDEX:
            yield ChunkIndex.read(body)
        elif opcode == Opcode.METADATA_INDEX:
            file.seek(MetadataIndex.read(body).offset)
            found, content = _next_record(file, size)
            if found == Opcode.METADATA:
                yield Metadata.read(_stream(content))


def index_problem(file: BinaryIO) -> str | None:
    """What is wrong with a file's index of chunks, in words; None for a good one."""
    size = os.fstat(file.fileno()).st_size
    indexed = {r.chunk_start_offset: r for r in summary_records(file) if isinstance(r, ChunkIndex)}
    found = 0
    file.seek(len(MCAP0_MAGIC))
    while True:
        at = file.tell()
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return "no end"
        opcode, length = _HEAD.unpack(head)
        if opcode == Opcode.DATA_END:
            break
        if opcode == Opcode.CHUNK:
            entry = indexed.get(at)
            if entry is None:
                return f"the chunk at byte {at} is not in it"
            if entry.chunk_length != _HEAD.size + length:
                return f"another length than that of the chunk at byte {at}"
            found += 1
        if at + _HEAD.size + length > size:
            return f"the record at byte {at} is longer than the file"
        file.seek(at + _HEAD.size + length)
    if found != len(indexed):
        return f"{len(indexed) - found} chunks that are not there"
    return None


def checksum_problem(file: BinaryIO) -> str | None:
    """What the checksum of all data says of a file that could be read to its end, in words.

    None where all is as it was written, or where nobody wrote a checksum.
    """
    file.seek(0)
    crc = zlib.crc32(file.read(len(MCAP0_MAGIC)))
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        opcode, length = _HEAD.unpack(head)
        if opcode == Opcode.DATA_END:
            (said,) = struct.unpack("<I", file.read(4))
            if said in (0, crc):
                return None
            return "the checksum of all data is wrong, and that of every chunk is right"
        crc = zlib.crc32(head, crc)
        while length and (block := file.read(min(length, _BLOCK))):
            crc = zlib.crc32(block, crc)
            length -= len(block)
    return None


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
