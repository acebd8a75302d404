"""The parts of an HTTP multipart stream, byte for byte.

FFmpeg reads such streams too. It gives half a frame for a whole one when the connection ends in the
middle of it, cannot go on after a time-out there, and hides the headers of the parts.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from http.client import HTTPException
from typing import NamedTuple, Protocol

_LINE_BYTES = 64 << 10
_PART_BYTES = 64 << 20
_JPEG_END = b"\xff\xd9"


class Readable(Protocol):
    """Blocks until it has all, or the stream ends."""

    def read(self, amount: int, /) -> bytes: ...

    def readline(self, limit: int, /) -> bytes: ...


class Part(NamedTuple):
    """One part of the stream.

    Attributes:
        headers: names in lower case.
        begun_ns: system time at which its headers were here.
        skipped: bytes before it that belong to no part.
    """

    headers: dict[str, str]
    data: bytes
    begun_ns: int
    skipped: int


class CutError(Exception):
    """The stream ended in the middle of a part."""


def parts(stream: Readable, boundary: str) -> Iterator[Part]:
    """The parts until the stream ends; a part without Content-Length ends at the next boundary.

    Args:
        boundary: as the response's Content-Type has it; with its dashes or without.

    Raises:
        CutError: the stream ended where it should not.
        ValueError: this is no multipart stream.
    """
    delimiter = b"--" + boundary.encode("latin-1").removeprefix(b"--")
    skipped = _skip_to(stream, delimiter)
    while skipped is not None:
        headers = _headers(stream)
        begun_ns = time.time_ns()
        length = headers.get("content-length", "")
        if length.isdecimal() and int(length) <= _PART_BYTES:
            yield Part(headers, _read_all(stream, int(length)), begun_ns, skipped)
            skipped = _skip_to(stream, delimiter)
        else:
            data, ended = _read_to(stream, delimiter)
            yield Part(headers, data, begun_ns, skipped)
            skipped = None if ended else 0


def _skip_to(stream: Readable, delimiter: bytes) -> int | None:
    """How many bytes there were before the next boundary line, empty lines aside; None: the end."""
    skipped = 0
    while line := stream.readline(_LINE_BYTES):
        if line.startswith(delimiter):
            return None if line.rstrip() == delimiter + b"--" else skipped
        skipped += len(line) if line.strip() else 0
        if skipped > _PART_BYTES:
            raise ValueError(f"expected the boundary {delimiter.decode('latin-1')}, found none")
    return None


def _headers(stream: Readable) -> dict[str, str]:
    headers: dict[str, str] = {}
    while line := stream.readline(_LINE_BYTES):
        if not line.strip():
            return headers
        name, _, value = line.decode("latin-1").partition(":")
        headers[name.strip().lower()] = value.strip()
    raise CutError("its headers were not complete")


def _read_all(stream: Readable, length: int) -> bytes:
    try:
        data = stream.read(length)
    except (OSError, HTTPException) as error:
        raise CutError(f"not all of its {length} bytes had come") from error
    if len(data) < length:
        raise CutError(f"{len(data)} of {length} bytes had come")
    return data


def _read_to(stream: Readable, delimiter: bytes) -> tuple[bytes, bool]:
    """Everything before the line break that precedes the next boundary line.

    With the stream's end instead of a boundary the part is whole if it ends as a JPEG does; the
    second value says that the stream ended.
    """
    data = bytearray()
    at_line_start = True
    while line := _line_or_end(stream):
        if at_line_start and line.startswith(delimiter):
            return _without_line_break(data), False
        data += line
        at_line_start = line.endswith(b"\n")
        if len(data) > _PART_BYTES:
            raise ValueError(f"expected the boundary {delimiter.decode('latin-1')}, found none")
    whole = _without_line_break(data)
    if not whole.endswith(_JPEG_END):
        raise CutError(f"{len(data)} bytes had come")
    return whole, True


def _line_or_end(stream: Readable) -> bytes:
    try:
        return stream.readline(_LINE_BYTES)
    except (OSError, HTTPException):
        return b""


def _without_line_break(data: bytearray) -> bytes:
    return bytes(data.removesuffix(b"\n").removesuffix(b"\r"))
