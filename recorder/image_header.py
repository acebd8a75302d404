"""What shows of a compressed image from outside: format, size, and whether its end is there."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import NamedTuple

# Bytes of no use before a JPEG's marker that are a webcam's habit, not damage.
MOST_PADDING = 16
_PADDING = b"[^\xff]{0,%d}" % MOST_PADDING
# Fill bytes may be before any marker.
_JPEG_MARKER = re.compile(_PADDING + rb"(\xff+([^\x00\xff]))")
# Start-of-frame markers of JPEG; C4, C8 and CC in between are other segments.
_JPEG_SOF = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_SCAN = 0xDA
_JPEG_BARE = frozenset(range(0xD0, 0xD9)) | {0x01}
_JPEG_END = b"\xff\xd9"
_PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
# No camera has so many: a size with a flipped bit in it would cost the memory.
_MOST_PIXELS = 2**28


class ImageHeader(NamedTuple):
    format: str  # jpeg, png or webp
    width_px: int
    height_px: int


class _Segment(NamedTuple):
    """A piece of a JPEG's header: the bytes from `start`, behind some padding, to `end`."""

    marker: int
    start: int
    body: int
    end: int


def read_header(data: bytes) -> ImageHeader | None:
    """The header of a JPEG, PNG or WebP image as it is stored (no EXIF rotation); else None."""
    header = None
    try:
        if data[:2] == b"\xff\xd8":
            header = _jpeg(data)
        elif data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR":
            header = ImageHeader("png", *struct.unpack_from(">II", data, 16))
        elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            header = _webp(data)
    except (struct.error, IndexError):
        return None
    if header is None or not 0 < header.width_px * header.height_px <= _MOST_PIXELS:
        return None
    return header


def image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height of compressed bytes, where their header says them."""
    header = read_header(data)
    return None if header is None else (header.width_px, header.height_px)


def image_fault(data: bytes, format: str) -> str | None:
    """Why compressed bytes are no whole image, in a few words; None where nothing shows.

    Only the header and the end are looked at: it is the part of `image_decoding.flaw` that costs
    nothing.
    """
    if not data:
        return "empty"
    header = read_header(data)
    if header is None or header.format != format:
        return f"not a readable {format} image"
    if is_cut(data, format):
        return f"a {format} image without its end"
    return None


def is_cut(data: bytes, format: str) -> bool:
    """Whether a JPEG or PNG image ends before its end; what cameras append does not count.

    A JPEG without its end marker is cut, also if that is all it lacks: it does not show how much
    was behind.
    """
    if format == "jpeg":
        # The marker cannot be in compressed data, only in a thumbnail in the header.
        return not data.endswith(_JPEG_END) and data.rfind(_JPEG_END, _scan_start(data)) < 0
    if format == "png":
        return not data.endswith(_PNG_END) and _PNG_END not in data
    return False


def without_padding(data: bytes) -> bytes:
    """A JPEG without what a webcam put between the segments of its header."""
    kept, at, start = [], 0, 2
    for segment in _segments(data):
        if segment.start > start:
            kept.append(data[at:start])
            at = segment.start
        start = segment.end
    return b"".join([*kept, data[at:]]) if kept else data


def _jpeg(data: bytes) -> ImageHeader | None:
    for segment in _segments(data):
        if segment.marker in _JPEG_SOF:
            height, width = struct.unpack_from(">HH", data, segment.body + 3)
            return ImageHeader("jpeg", width, height)
    return None


def _scan_start(data: bytes) -> int:
    """Where a JPEG's header ends; the end of `data` where it does not get there."""
    ends = (segment.end for segment in _segments(data) if segment.marker == _JPEG_SCAN)
    return next(ends, len(data))


def _segments(data: bytes) -> Iterator[_Segment]:
    """Those of a JPEG's header behind its first marker, up to that of the first scan."""
    at, marker = 2, 0
    while marker != _JPEG_SCAN and (found := _JPEG_MARKER.match(data, at)):
        marker, body = found[2][0], found.end()
        if marker in _JPEG_BARE:
            at = body
        else:
            length = int.from_bytes(data[body : body + 2])
            # Cut here, or the end.
            if length < 2 or marker == _JPEG_END[1]:
                return
            at = body + length
        yield _Segment(marker, found.start(1), body, at)


def _webp(data: bytes) -> ImageHeader | None:
    kind = data[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return ImageHeader("webp", width & 0x3FFF, height & 0x3FFF)
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return ImageHeader("webp", (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)
    if kind == b"VP8X":
        width = int.from_bytes(data[24:27], "little") + 1
        height = int.from_bytes(data[27:30], "little") + 1
        return ImageHeader("webp", width, height)
    return None
