"""Pixels that come uncompressed, or in a codec that a log does not keep, as JPEG or PNG."""

from __future__ import annotations

from typing import Literal

import cv2
from cv2.typing import MatLike

Encoding = Literal["jpeg", "png"]

_JPEG_QUALITY = 95


def encoded_image(image: MatLike, encoding: Encoding) -> bytes:
    """A grey or BGR image as PNG or, with 8 bits a pixel, as JPEG of quality 95."""
    if encoding == "png":
        _, data = cv2.imencode(".png", image)
    else:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return data.tobytes()
