"""Small logs and what they are made of."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

from pipeline.camera import Camera
from pipeline.geometry import Pose, rotation_z
from pipeline.markers import Marker, MarkerMap
from recorder.files.camera_file import camera_yaml
from recorder.files.map_file import map_yaml
from recorder.log.reader import LogReader
from recorder.log.records import LogImage
from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame

TRUTH_YAML = b"""\
frame: map
method: tape
path: {points_m: [[0, 0], [3, 0], [3, 2]], closed: true, std_m: 0.05}
poses:
  - {from_s: 0, to_s: 1, x_m: 0.1, y_m: 0.2, z_m: 1.3, yaw_deg: 90, std_m: 0.005}
  - {from_s: 2, to_s: 3, x_m: 0.4, y_m: 0.5, std_m: 0.005}
"""


def camera(width_px: int = 64, height_px: int = 48) -> Camera:
    matrix = np.array([[50.0, 0, 31.5], [0, 51.0, 23.5], [0, 0, 1]])
    return Camera(
        width_px, height_px, matrix, "plumb_bob", np.array([-0.1, 0.01, 0, 0, 0]), "small"
    )


def marker_map() -> MarkerMap:
    markers = [
        Marker.from_yaw(i, (0.5 * i, 0.25, 2.5), 0.1 * i, "down", 0.15, tags=("ceiling",))
        for i in range(4)
    ]
    return MarkerMap("map", "DICT_6X6_1000", tuple(markers))


def attachments() -> dict[str, bytes]:
    return {
        "camera.yaml": camera_yaml(camera()),
        "map.yaml": map_yaml(marker_map()),
        "truth.yaml": TRUTH_YAML,
    }


def png(width_px: int = 64, height_px: int = 48, payload: bytes = b"") -> bytes:
    """A gray PNG; a payload takes the place of the pixels, which then nobody can decode."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", width_px, height_px, 8, 0, 0, 0, 0)
    pixels = payload or zlib.compress(bytes(height_px * (width_px + 1)))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def frame(index: int, *, step_ns: int = 100_000_000, size: int = 2000) -> CapturedFrame:
    """Frame `index` of a steady camera, with noise as its pixels and its exact pose."""
    rng = np.random.default_rng(index)
    stamp_ns = 1_700_000_000_123_456_789 + index * step_ns
    pose = Pose(rotation_z(0.1 * index), np.array([0.01 * index, 0.5, 1.0]))
    return CapturedFrame(index, stamp_ns, stamp_ns + 7, png(payload=rng.bytes(size)), "png", pose)


def write_log(path: Path, count: int = 30, **frame_options: int) -> list[CapturedFrame]:
    frames = [frame(i, **frame_options) for i in range(count)]
    with LogWriter(path, attachments=attachments(), session={"host": "test"}) as writer:
        for item in frames:
            writer.write_frame(item)
    return frames


def images(log: LogReader) -> list[LogImage]:
    return [r for r in log.records() if isinstance(r, LogImage)]


def same_image(image: LogImage, frame: CapturedFrame) -> bool:
    """Number, both times, bytes and format."""
    return (image.frame_index, image.timestamp_ns, image.arrival_ns, image.data, image.format) == (
        frame.frame_index,
        frame.timestamp_ns,
        frame.arrival_ns,
        frame.data,
        frame.format,
    )
