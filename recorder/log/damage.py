"""Where a log is damaged, and where it can be read on behind that."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO

from mcap.opcode import Opcode

RECORD_HEAD = struct.Struct("<BQ")

# opcode, length, first and last log time, size and CRC of the records, length of "zstd" or "lz4"
_CHUNK_HEAD = struct.Struct("<BQQQQII")
# What a chunk is beside its records and the name of their compression.
CHUNK_OVERHEAD = _CHUNK_HEAD.size - RECORD_HEAD.size + 8
# A chunk below 4 GiB: rare enough by chance in compressed images, and checked closer where found.
_CHUNK_LIKE = re.compile(rb"\x06.{4}\x00{4}", re.DOTALL)
_BLOCK = 1 << 20
_LONGEST_NAME = 4
_CODES = frozenset(int(code) for code in Opcode)


@dataclass(frozen=True)
class Damage:
    """A piece of a log that was left out.

    Attributes:
        offset: where it begins in the file.
        size: its bytes.
        reason: in a few words.
        after_frames: images read before it.
    """

    offset: int
    size: int
    reason: str
    after_frames: int = 0

    def __str__(self) -> str:
        frames = "frame" if self.after_frames == 1 else "frames"
        return (
            f"{self.reason} after {self.after_frames} {frames} "
            f"(byte {self.offset}, {self.size} bytes left out)"
        )


def damage_text(damage: Sequence[Damage]) -> str | None:
    """In one line; None where there is none."""
    if not damage:
        return None
    more = f", and {len(damage) - 1} more" if len(damage) > 1 else ""
    return f"damaged: {damage[0]}{more}"


def resume_at(file: BinaryIO, damaged_at: int, size: int) -> int | None:
    """Where the record behind a damaged one begins; None where nothing can be read any more.

    Args:
        damaged_at: offset of the damaged record's first byte.
        size: of the file.
    """
    file.seek(damaged_at)
    head = file.read(RECORD_HEAD.size)
    if len(head) == RECORD_HEAD.size:
        opcode, length = RECORD_HEAD.unpack(head)
        behind: int = damaged_at + RECORD_HEAD.size + length
        if opcode in _CODES and behind < size and _is_record(file, behind, size):
            return behind
    return _next_chunk(file, damaged_at + 1, size)


def _is_record(file: BinaryIO, at: int, size: int) -> bool:
    file.seek(at)
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return False
    opcode, length = RECORD_HEAD.unpack(head)
    return opcode in _CODES and at + RECORD_HEAD.size + length <= size


def _next_chunk(file: BinaryIO, start: int, size: int) -> int | None:
    """The next whole chunk at or behind `start`."""
    at = start
    while at < size:
        file.seek(at)
        block = file.read(_BLOCK + _CHUNK_HEAD.size)
        for match in _CHUNK_LIKE.finditer(block, 0, min(len(block), _BLOCK + 8)):
            if _is_chunk(block[match.start() :], size - at - match.start()):
                return at + match.start()
        at += _BLOCK
    return None


def _is_chunk(head: bytes, left: int) -> bool:
    """The sizes in a chunk's header fit to one another and into what is left of the file."""
    if len(head) < _CHUNK_HEAD.size:
        return False
    _, length, first, last, content, _, name = _CHUNK_HEAD.unpack_from(head)
    if name > _LONGEST_NAME or first > last or RECORD_HEAD.size + length > left:
        return False
    rest = length - CHUNK_OVERHEAD - name
    return rest > 0 and (bool(name) or rest == content)
