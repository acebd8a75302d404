"""Pixels of compressed images, and whether an image is damaged inside."""

from __future__ import annotations

import re

import av
import cv2
import numpy as np
import simplejpeg
from cv2.typing import MatLike
from numpy.typing import NDArray

# The sensor's own rows and columns, whatever an EXIF tag says: those were calibrated.
_GRAY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
_JPEG_START = b"\xff\xd8"
_JPEG_END = b"\xff\xd9"
# What libjpeg says of bytes that it has no use for. Webcams pad the data of good images with up to
# nine (https://github.com/Motion-Project/motion/issues/65); damage leaves hundreds.
_LEFT_OVER = re.compile(r"(\d+) extraneous bytes before marker")
_PADDING = 16
# Of eight, the strongest reduction, which takes the least time.
_REDUCTION = 8


def decode_gray(data: bytes) -> NDArray[np.uint8] | None:
    """The gray image (H, W) in compressed bytes; None if there is none, or a part is damaged.

    Pixels are those of `cv2.imdecode`, which however makes do with a damaged JPEG: it shows the
    rest shifted, or in gray.
    """
    if not data.startswith(_JPEG_START):
        image = _imdecode(data, _GRAY)
        return None if image is None else np.asarray(image, dtype=np.uint8)
    try:
        return _jpeg(data)
    except ValueError as error:
        return _jpeg(data, strict=False) if _is_padded_only(data, error) else None


def flaw(data: bytes, format: str) -> str | None:
    """What is wrong inside a compressed image, in a few words; None for a good one.

    It is decoded as far as that takes. A flipped bit may still be another picture's good code.
    """
    if format != "jpeg":
        image = _imdecode(data, cv2.IMREAD_REDUCED_GRAYSCALE_2)
        return f"no {format} image that can be decoded" if image is None else None
    try:
        _jpeg(data, reduction=_REDUCTION)
    except ValueError as error:
        return None if _is_padded_only(data, error) else "a damaged jpeg image"
    return None


def _jpeg(data: bytes, *, strict: bool = True, reduction: int = 1) -> NDArray[np.uint8]:
    """
    Raises:
        ValueError: it cannot be decoded, or, if `strict`, anything is odd about it.
    """
    # One that only lacks its end is complete: the recorder tells of it.
    ended = data if data.endswith(_JPEG_END) else data + _JPEG_END
    smallest = 1 if reduction > 1 else 0
    image = simplejpeg.decode_jpeg(
        ended,
        "GRAY",
        min_height=smallest,
        min_width=smallest,
        min_factor=reduction,
        strict=strict,
    )
    return np.asarray(image[:, :, 0], dtype=np.uint8)


def _is_padded_only(data: bytes, error: ValueError) -> bool:
    """Whether libjpeg's first complaint is about a few bytes left over, and FFmpeg's decoder, told
    to give up at the first error, finds nothing else either."""
    left_over = _LEFT_OVER.search(str(error))
    if left_over is None or int(left_over[1]) > _PADDING:
        return False
    decoder = av.CodecContext.create("mjpeg", "r")
    decoder.options = {"err_detect": "explode", "lowres": "3"}
    decoder.thread_count = 1
    try:
        return len(decoder.decode(av.Packet(data))) + len(decoder.decode(None)) == 1
    except av.FFmpegError:
        return False


def _imdecode(data: bytes, flags: int) -> MatLike | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:
        return None
