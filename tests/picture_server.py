"""An HTTP MJPEG camera on loopback that drives under a ceiling of markers."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2

from pipeline.geometry import Pose
from recorder.files.camera_file import camera_yaml
from recorder.files.map_file import map_yaml
from tests import worlds
from tests.mjpeg_server import Frames, MjpegProcess, MjpegServer, Script

ATTACHMENTS = {
    "camera.yaml": camera_yaml(worlds.camera(ideal=True)),
    "map.yaml": map_yaml(worlds.ceiling()),
}
_PICTURES = 40


@cache
def pictures() -> tuple[bytes, ...]:
    """JPEGs of 1280x720, there and back again."""
    lens, marker_map = worlds.camera(ideal=True), worlds.ceiling()
    way: list[Pose] = worlds.drive(_PICTURES // 2)
    drawn = [cv2.imencode(".jpg", worlds.draw(pose, lens, marker_map))[1].tobytes() for pose in way]
    return (*drawn, *reversed(drawn))


class PictureFrames(Frames):
    """The pictures, each with its number in a comment."""

    def __init__(self, script: Script, jpegs: Sequence[bytes]) -> None:
        super().__init__(script)
        starts = [data[:-2] for data in jpegs]
        self._starts = [(start, hashlib.sha256(start)) for start in starts]

    def good(self, number: int) -> tuple[bytes, str]:
        start, digest = self._starts[number % len(self._starts)]
        end = b"\xff\xfe\x00\x0a" + number.to_bytes(8, "big") + b"\xff\xd9"
        whole = digest.copy()
        whole.update(end)
        return start + end, whole.hexdigest()


class PictureServer(MjpegServer):
    """Serves the pictures, or other JPEGs, to a script."""

    def __init__(
        self, script: Script, log: Path | None = None, jpegs: Sequence[bytes] | None = None
    ) -> None:
        frames = PictureFrames(script, jpegs or pictures())
        super().__init__(script, log)
        self._frames = frames


class PictureProcess(MjpegProcess):
    """Serves the JPEGs of a folder, by name, from a process of its own."""

    module = "tests.picture_server"

    def __init__(self, script: Script, log: Path, folder: Path) -> None:
        super().__init__(script, log, str(folder))


if __name__ == "__main__":
    jpegs = [path.read_bytes() for path in sorted(Path(sys.argv[3]).iterdir())]
    server = PictureServer(Script.from_json(sys.argv[1]), Path(sys.argv[2]), jpegs)
    print(server.url, flush=True)
    server.wait()
