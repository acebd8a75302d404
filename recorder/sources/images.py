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
from recorder.image_header import read_header
from recorder.sources.base import CapturedFrame, SourceEvent

PASSED_THROUGH = {".jpg": "jpeg", ".jpeg": "jpeg", ".png": "png", ".webp": "webp"}
ENCODED = frozenset({".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".pnm"})
IMAGE_SUFFIXES = ENCODED.union(PASSED_THROUGH)

# Enough for nearly every header; a JPEG may have a large preview before it.
_HEAD_BYTES = 64 << 10
_SHOWN = 3


class ImagesSource:
    """The images of a folder in natural order (2 before 10), or one image.

    JPEG, PNG and WebP keep their bytes, also where no header can be read in them; other formats
    become PNG, losslessly, and one that cannot be decoded is a lost frame.
    """

    def __init__(self, path: Path, *, fps: Fraction | None = None, start_ns: int = 0) -> None:
        """Looks at the size of every image.

        Args:
            fps: images a second; one where nothing is said.
            start_ns: capture time of the first.

        Raises:
            InputError: no images, none that can be read, or two of different sizes.
        """
        if path.is_dir():
            found = [p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
            self._files = sorted((p for p in found if p.name[0] != "."), key=natural_key)
        else:
            self._files = [path]
        if not self._files:
            suffixes = ", ".join(sorted(IMAGE_SUFFIXES))
            raise InputError(path, f"expected images ({suffixes}), found {_others(path)}")
        self.name = path.resolve().name if path.is_dir() else path.stem
        self._path = path
        self._fps = Fraction(1) if fps is None else fps
        self._assumed = fps is None and len(self._files) > 1
        self._start_ns = start_ns
        first, self._image_size, unreadable = _common_size(self._files)
        if first is None:
            kind = self._files[0].suffix.lower().lstrip(".")
            raise InputError(self._files[0], f"expected a {kind} image, found something else")
        self._lost = sum(file.suffix.lower() in ENCODED for file in unreadable)

    @property
    def files(self) -> tuple[Path, ...]:
        """In the order of the frames: a frame's number is its file's place here."""
        return tuple(self._files)

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
        return len(self._files) - self._lost

    def preparation(self) -> str | None:
        return "images are taken as one a second (--fps changes it)" if self._assumed else None

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        for i, file in enumerate(self._files):
            timestamp_ns = self._start_ns + round(i * 10**9 / self._fps)
            if timestamp_ns >= 2**63:
                raise InputError(
                    self._path, "expected times before 2262, found later ones (--start, --fps)"
                )
            data = read_bytes(file)
            suffix = file.suffix.lower()
            if suffix in PASSED_THROUGH:
                # The suffix may be wrong; the first bytes are not.
                header = read_header(data)
                format = header.format if header else PASSED_THROUGH[suffix]
                yield CapturedFrame(i, timestamp_ns, timestamp_ns, data, format)
            elif png := _as_png(file, data):
                yield CapturedFrame(i, timestamp_ns, timestamp_ns, png, "png")
            else:
                text = f"frame {i} is lost: {file.name} is not a readable image"
                yield SourceEvent(timestamp_ns, "warning", text, dropped=1)


def _others(folder: Path) -> str:
    """What is in a folder without images."""
    names = sorted(p.name for p in folder.iterdir() if p.name[0] != ".")
    shown = ", ".join(names[:_SHOWN])
    return shown + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "") or "none"


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Orders numbers inside names by value, names that differ in zeros only by their text."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(int(p), "") if p.isdecimal() else (-1, p) for p in parts], path.name


def _common_size(files: list[Path]) -> tuple[Path | None, tuple[int, int], list[Path]]:
    """The first file with a size, the size of all that have one, and those that have none."""
    first: Path | None = None
    common = (0, 0)
    without = []
    for file in files:
        size = _size(file)
        if size is None:
            without.append(file)
        elif first is None:
            first, common = file, size
        elif size != common:
            raise InputError(
                file,
                f"expected the size of {first.name}, {common[0]}x{common[1]}, "
                f"found {size[0]}x{size[1]}",
            )
    return first, common, without


def _size(path: Path) -> tuple[int, int] | None:
    if path.suffix.lower() in PASSED_THROUGH:
        head = read_bytes(path, _HEAD_BYTES)
        header = read_header(head)
        if header is None and len(head) == _HEAD_BYTES:
            header = read_header(read_bytes(path))
        return (header.width_px, header.height_px) if header else None
    image = _decoded(path, read_bytes(path))
    return (image.shape[1], image.shape[0]) if image is not None else None


def _decoded(path: Path, data: bytes) -> MatLike | None:
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        return None
    if image is not None and image.dtype not in (np.uint8, np.uint16):
        raise InputError(path, f"expected 8 or 16 bits a pixel, found {image.dtype}")
    return image


def _as_png(path: Path, data: bytes) -> bytes | None:
    image = _decoded(path, data)
    return None if image is None else cv2.imencode(".png", image)[1].tobytes()
