"""Pixels of compressed images, and whether an image is whole."""

from __future__ import annotations

import re

import av
import cv2
import numpy as np
import simplejpeg
from cv2.typing import MatLike
from numpy.typing import NDArray

from recorder.image_header import MOST_PADDING, image_fault, is_cut, read_header, without_padding

# The sensor's own rows and columns, whatever an EXIF tag says: those were calibrated.
_GRAY = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
_JPEG_START = b"\xff\xd8"
# What libjpeg says of bytes that it has no use for. Webcams pad the data of good images with up to
# nine (https://github.com/Motion-Project/motion/issues/65); damage leaves hundreds.
_LEFT_OVER = re.compile(r"(\d+) extraneous bytes before marker")
# Of eight, the strongest reduction, which takes the least time.
_REDUCTION = 8


def decode_gray(data: bytes, size: tuple[int, int] | None = None) -> NDArray[np.uint8] | None:
    """The gray image (H, W) in compressed bytes; None if there is none, or it is not whole.

    Pixels are those of `cv2.imdecode`, which however makes do with a damaged JPEG: it shows the
    rest shifted, or in gray. There is an image exactly where `flaw` finds nothing.

    Args:
        size: width and height; an image of another size is none.
    """
    is_jpeg = data.startswith(_JPEG_START)
    header = read_header(data)
    if header is not None:
        if size not in (None, header[1:]) or is_cut(data, header.format):
            return None
    elif is_jpeg:
        return None
    image = _whole_jpeg(data) if is_jpeg else _imdecode(data)
    if image is None or size not in (None, image.shape[::-1]):
        return None
    return np.asarray(image, dtype=np.uint8)


def flaw(data: bytes, format: str) -> str | None:
    """What is wrong with a compressed image, in a few words; None for a whole one.

    It is decoded as far as that takes. A flipped bit may still be another picture's good code.
    """
    if (fault := image_fault(data, format)) is not None:
        return fault
    if format == "jpeg":
        return "a damaged jpeg image" if _whole_jpeg(data, _REDUCTION) is None else None
    return f"no {format} image that can be decoded" if _imdecode(data) is None else None


def _whole_jpeg(data: bytes, reduction: int = 1) -> MatLike | None:
    """The gray image, smaller by `reduction`; None if it is damaged."""
    # In the header libjpeg takes it for a fault, and OpenCV prints a line for each.
    data = without_padding(data)
    try:
        return _jpeg(data, reduction, strict=True)
    except ValueError as error:
        if not _is_padded_only(data, error):
            return None
    try:
        return _jpeg(data, reduction, strict=False)
    except ValueError:
        return None


def _jpeg(data: bytes, reduction: int, *, strict: bool) -> MatLike:
    """
    Raises:
        ValueError: it cannot be decoded, or, if `strict`, anything is odd about it.
    """
    smallest = 1 if reduction > 1 else 0
    image: NDArray[np.uint8] = simplejpeg.decode_jpeg(
        data,
        "GRAY",
        min_height=smallest,
        min_width=smallest,
        min_factor=reduction,
        strict=strict,
    )
    return image[:, :, 0]


def _is_padded_only(data: bytes, error: ValueError) -> bool:
    """Whether libjpeg's first complaint is about a few bytes left over, and FFmpeg's decoder, told
    to give up at the first error, finds nothing else either."""
    left_over = _LEFT_OVER.search(str(error))
    if left_over is None or int(left_over[1]) > MOST_PADDING:
        return False
    decoder = av.CodecContext.create("mjpeg", "r")
    decoder.options = {"err_detect": "explode", "lowres": "3"}
    decoder.thread_count = 1
    try:
        return len(decoder.decode(av.Packet(data))) + len(decoder.decode(None)) == 1
    except (av.FFmpegError, ValueError):
        return False


def _imdecode(data: bytes) -> MatLike | None:
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), _GRAY) if data else None
    except cv2.error:
        return None
