"""Gray images to the bytes a camera gives."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt


def encode(
    image: npt.NDArray[np.uint8], encoding: Literal["jpeg", "png"], jpeg_quality: int
) -> bytes:
    """A gray image (H, W) as one JPEG or PNG file."""
    if encoding == "png":
        done, data = cv2.imencode(".png", image)
    else:
        done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality])
    if not done:
        raise RuntimeError(f"OpenCV could not encode a {image.shape} image as {encoding}")
    return data.tobytes()
