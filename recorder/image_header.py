"""Format and size of a compressed image from its first bytes, and its end, without decoding it."""

from __future__ import annotations

import struct
from typing import NamedTuple

# Start-of-frame markers of JPEG; C4, C8 and CC in between are other segments.
_JPEG_SOF = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_BARE = frozenset(range(0xD0, 0xD9)) | {0x01}
_JPEG_END = b"\xff\xd9"
_JPEG_APPENDED = 4096
# Bytes of no use before a JPEG's marker that are a webcam's habit, not damage.
MOST_PADDING = 16


class ImageHeader(NamedTuple):
    format: str  # jpeg, png or webp
    width_px: int
    height_px: int


def read_header(data: bytes) -> ImageHeader | None:
    """The header of a JPEG, PNG or WebP image as it is stored (no EXIF rotation); else None."""
    try:
        if data[:2] == b"\xff\xd8":
            return _jpeg(data)
        if data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR":
            return ImageHeader("png", *struct.unpack_from(">II", data, 16))
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp(data)
    except (struct.error, IndexError):
        pass
    return None


def is_cut(data: bytes, format: str) -> bool:
    """Whether a JPEG or PNG image ends before its end; what cameras append does not count."""
    if format == "jpeg":
        # The end-of-image marker cannot be in compressed data, only in a thumbnail at the start.
        return data[-2:] != _JPEG_END and data.rfind(_JPEG_END, -_JPEG_APPENDED) < 0
    if format == "png":
        return data[-8:-4] != b"IEND"
    return False


def _jpeg(data: bytes) -> ImageHeader | None:
    at = 2
    # Some webcams pad their segments.
    while (at := data.find(b"\xff", at, at + MOST_PADDING + 1)) >= 0:
        marker = data[at + 1]
        if marker == 0xFF:  # a fill byte
            at += 1
        elif marker in _JPEG_BARE:
            at += 2
        elif marker in _JPEG_SOF:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return ImageHeader("jpeg", width, height)
        else:
            (length,) = struct.unpack_from(">H", data, at + 2)
            at += 2 + length
    return None


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
