"""A folder of images as a source."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from cv2.typing import MatLike

from recorder.errors import InputError
from recorder.files.yaml_file import read_bytes
from recorder.image_header import ImageHeader, read_header
from recorder.sources.base import CapturedFrame

PASSED_THROUGH = frozenset({".jpg", ".jpeg", ".png", ".webp"})
ENCODED = frozenset({".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm"})
IMAGE_SUFFIXES = PASSED_THROUGH | ENCODED


class ImagesSource:
    """The images of a folder in natural order (2 before 10), or one image.

    JPEG, PNG and WebP keep their bytes; other formats become PNG, losslessly.
    """

    def __init__(self, path: Path, *, fps: Fraction = Fraction(1), start_ns: int = 0) -> None:
        """Looks at the size of every image.

        Raises:
            InputError: no images, one that cannot be read, or another size than the first one's.
        """
        if path.is_dir():
            found = [p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
            self._files = sorted((p for p in found if p.name[0] != "."), key=natural_key)
        else:
            self._files = [path]
        if not self._files:
            suffixes = ", ".join(sorted(IMAGE_SUFFIXES))
            raise InputError(path, f"expected images ({suffixes}), found none")
        self.name = path.resolve().name if path.is_dir() else path.stem
        self._path = path
        self._fps = fps
        self._start_ns = start_ns
        self._image_size = _size(self._files[0])
        for file in self._files[1:]:
            size = _size(file)
            if size != self._image_size:
                raise InputError(
                    file,
                    f"expected the size of {self._files[0].name}, "
                    f"{self._image_size[0]}x{self._image_size[1]}, found {size[0]}x{size[1]}",
                )

    def describe(self) -> dict[str, str]:
        return {
            "kind": "images",
            "name": self._path.resolve().name,
            "images": str(len(self._files)),
            "fps": str(self._fps),
            "start_ns": str(self._start_ns),
        }

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return {}

    @property
    def image_size(self) -> tuple[int, int]:
        return self._image_size

    def frame_count(self) -> int | None:
        return len(self._files)

    def frames(self) -> Iterator[CapturedFrame]:
        for i, file in enumerate(self._files):
            data = read_bytes(file)
            format = "png"
            if file.suffix.lower() in PASSED_THROUGH:
                # The suffix may be wrong; the first bytes are not.
                format = _header(file, data).format
            else:
                data = _as_png(file, data)
            timestamp_ns = self._start_ns + round(i * 10**9 / self._fps)
            yield CapturedFrame(i, timestamp_ns, timestamp_ns, data, format)


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Orders numbers inside names by value, names that differ in zeros only by their text."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in parts], path.name


def _size(path: Path) -> tuple[int, int]:
    data = read_bytes(path)
    if path.suffix.lower() in PASSED_THROUGH:
        header = _header(path, data)
        return header.width_px, header.height_px
    height, width = _decoded(path, data).shape[:2]
    return width, height


def _header(path: Path, data: bytes) -> ImageHeader:
    header = read_header(data)
    if header is None:
        raise InputError(path, f"expected a {path.suffix.lstrip('.')} image, found something else")
    return header


def _decoded(path: Path, data: bytes) -> MatLike:
    buffer = np.frombuffer(data, np.uint8)
    image = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED) if len(buffer) else None
    if image is None:
        raise InputError(path, f"expected a {path.suffix.lstrip('.')} image, found something else")
    return image


def _as_png(path: Path, data: bytes) -> bytes:
    image = _decoded(path, data)
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(path, f"expected 8 or 16 bits a pixel, found {image.dtype}")
    _, encoded = cv2.imencode(".png", image)
    return encoded.tobytes()
