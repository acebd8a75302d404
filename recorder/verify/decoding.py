"""Looks into images: can they be decoded without a flaw?"""

from __future__ import annotations

import av
import cv2
import numpy as np


def flaw(data: bytes, format: str) -> str | None:
    """What is wrong inside a compressed image, in a few words; None for a good one.

    JPEG goes through FFmpeg's decoder, told to give up at the first error: OpenCV's makes do with
    what it finds. A flipped bit may still be another picture's good code.
    """
    if format == "jpeg":
        return None if _is_good_jpeg(data) else "a damaged jpeg image"
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_2)
    except cv2.error:
        image = None
    return f"no {format} image that can be decoded" if image is None else None


def _is_good_jpeg(data: bytes) -> bool:
    decoder = av.CodecContext.create("mjpeg", "r")
    decoder.options = {"err_detect": "explode"}
    decoder.thread_count = 1
    try:
        return len(decoder.decode(av.Packet(data))) + len(decoder.decode(None)) == 1
    except av.FFmpegError:
        return False
