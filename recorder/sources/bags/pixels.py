"""sensor_msgs/Image as OpenCV has images."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class RosImage(Protocol):
    """The fields of a sensor_msgs/Image."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: npt.NDArray[np.uint8]


# Type and channels in the message, then OpenCV's conversion to grey or BGR. ROS names a Bayer
# pattern by its first row's first pixels, OpenCV by the second row's second and third.
_ENCODINGS: dict[str, tuple[type[np.uint8] | type[np.uint16], int, int | None]] = {
    "mono8": (np.uint8, 1, None),
    "8UC1": (np.uint8, 1, None),
    "mono16": (np.uint16, 1, None),
    "16UC1": (np.uint16, 1, None),
    "bgr8": (np.uint8, 3, None),
    "8UC3": (np.uint8, 3, None),
    "rgb8": (np.uint8, 3, cv2.COLOR_RGB2BGR),
    "bgra8": (np.uint8, 4, cv2.COLOR_BGRA2BGR),
    "8UC4": (np.uint8, 4, cv2.COLOR_BGRA2BGR),
    "rgba8": (np.uint8, 4, cv2.COLOR_RGBA2BGR),
    "bgr16": (np.uint16, 3, None),
    "rgb16": (np.uint16, 3, cv2.COLOR_RGB2BGR),
    "bayer_rggb8": (np.uint8, 1, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": (np.uint8, 1, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": (np.uint8, 1, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": (np.uint8, 1, cv2.COLOR_BayerGB2BGR),
    "bayer_rggb16": (np.uint16, 1, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr16": (np.uint16, 1, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg16": (np.uint16, 1, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg16": (np.uint16, 1, cv2.COLOR_BayerGB2BGR),
    "yuv422": (np.uint8, 2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (np.uint8, 2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (np.uint8, 2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (np.uint8, 2, cv2.COLOR_YUV2BGR_YUY2),
}


def known_encoding(encoding: str) -> bool:
    return encoding in _ENCODINGS


def is_deep(encoding: str) -> bool:
    """Whether it has 16 bits a pixel, which JPEG cannot hold."""
    return _ENCODINGS[encoding][0] is np.uint16


def pixels_of(image: RosImage) -> Pixels:
    """Grey (H, W) or BGR (H, W, 3); a Bayer pattern becomes BGR.

    Raises:
        ValueError: an unknown encoding, or data that does not fit the size.
    """
    if image.encoding not in _ENCODINGS:
        raise ValueError(f"expected a known encoding, found {image.encoding!r}")
    kind, channels, conversion = _ENCODINGS[image.encoding]
    item = np.dtype(kind).newbyteorder(">" if image.is_bigendian else "<")
    row_bytes = image.width * channels * item.itemsize
    if not row_bytes or image.step < row_bytes or image.data.size < image.step * image.height:
        raise ValueError(
            f"expected {image.height} rows of {row_bytes} bytes, found {image.data.size} bytes in "
            f"rows of {image.step}"
        )
    rows = image.data[: image.step * image.height].reshape(image.height, image.step)
    packed = np.ascontiguousarray(rows[:, :row_bytes]).view(item).astype(kind, copy=False)
    shaped = packed.reshape(image.height, image.width, channels)
    result = shaped[:, :, 0] if channels == 1 else shaped
    if conversion is not None:
        result = cv2.cvtColor(np.ascontiguousarray(result), conversion)
    return np.ascontiguousarray(result)
