"""A topic of a ROS bag as a source."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from recorder.errors import InputError
from recorder.files.camera_file import camera_yaml
from recorder.image_header import read_header
from recorder.log.topics import CAMERA_FILE
from recorder.sources.bags import bag, pixels
from recorder.sources.bags.calibration import camera_of, info_topic, is_rectified
from recorder.sources.bags.faults import reason
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.sources.encoding import Encoding, encoded_image

# Images without a size at the start of a bag, before it counts as one without images.
_UNREADABLE_AT_START = 100


class BagSource:
    """The images of one topic, with the CameraInfo beside it as the calibration.

    Compressed images keep their bytes. Others become PNG, losslessly (a Bayer pattern as the
    colours it stands for), or JPEG of quality 95. Capture is the stamp in the message's header,
    arrival the time at which the bag got it; frames are counted from 0.
    """

    def __init__(
        self, path: Path, *, topic: str | None = None, encoding: Encoding | None = None
    ) -> None:
        """Looks at the topics, the first image and the calibration.

        Raises:
            InputError: no bag, no images, several topics of them and none given.
        """
        self.name = path.resolve().stem
        self._path = path
        self._warnings: list[str] = []
        with bag.open_bag(path) as reader:
            connections = bag.image_topic(reader, path, topic)
            self._topic = connections[0].topic
            self._compressed = connections[0].msgtype == bag.COMPRESSED
            self._count = sum(c.msgcount for c in connections)
            self._encoding: Encoding = encoding or "png"
            if self._compressed and encoding is not None:
                raise InputError(
                    path, f"expected no --encoding for compressed images, found {encoding}"
                )
            first, self._image_size = self._first_image(reader, connections)
            self._from = str(first.format if self._compressed else first.encoding)
            self._calibration = self._calibration_of(reader, str(first.header.frame_id))

    def describe(self) -> dict[str, str]:
        return {
            "kind": "ROS bag",
            "name": self._path.resolve().name,
            "bag": bag.kind_of(self._path),
            "topic": self._topic,
            "encoding": "as it is" if self._compressed else f"{self._encoding} of {self._from}",
            "calibration": info_topic(self._topic) if self._calibration else "none",
            "clock": "header stamps of the bag",
        }

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return {CAMERA_FILE: self._calibration} if self._calibration else {}

    @property
    def image_size(self) -> tuple[int, int]:
        return self._image_size

    def frame_count(self) -> int | None:
        return self._count

    def preparation(self) -> str | None:
        return None

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        last_ns = index = 0
        with bag.open_bag(self._path) as reader:
            connections = [c for c in reader.connections if c.topic == self._topic]
            last_ns = reader.start_time
            for text in self._warnings:
                yield SourceEvent(last_ns, "warning", text)
            messages = self._messages(reader, connections)
            while (entry := next(messages, None)) is not None:
                if isinstance(entry, str):
                    lost = max(0, self._count - index)
                    text = f"the bag cannot be read after frame {index - 1}: {entry}"
                    yield SourceEvent(last_ns, "error", text, dropped=lost)
                    return
                item = self._item(index, *entry)
                last_ns = item.timestamp_ns
                yield item
                index += 1
            if index < self._count:
                text = f"the bag says that it has {self._count} images, and has {index}"
                yield SourceEvent(last_ns, "error", text, dropped=self._count - index)

    def _messages(
        self, reader: AnyReader, connections: list[Connection]
    ) -> Iterator[tuple[int, Any] | str]:
        """When the bag got each message, and the message or None where that is damaged.

        The last may be a text that says why the bag cannot be read on.
        """
        try:
            for connection, arrival_ns, raw in reader.messages(connections=connections):
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception:  # whatever a decoder runs into in damaged bytes
                    message = None
                yield arrival_ns, message
        except Exception as error:  # rosbags lets through what its storages trip over
            yield reason(error)

    def _item(self, index: int, arrival_ns: int, message: Any) -> CapturedFrame | SourceEvent:
        if message is None:
            return SourceEvent(arrival_ns, "warning", f"frame {index} is corrupt", dropped=1)
        stamp = message.header.stamp
        timestamp_ns = stamp.sec * 10**9 + stamp.nanosec
        # A driver that stamps nothing leaves zeros.
        timestamp_ns = timestamp_ns if timestamp_ns > 0 else arrival_ns
        problem = None
        data, format = b"", str(self._encoding)
        if self._compressed:
            data = message.data.tobytes()
            header = read_header(data)
            format = header.format if header else _named_format(message.format)
        else:
            try:
                data = encoded_image(pixels.pixels_of(message), self._encoding)
            except ValueError as error:
                problem = f"is no image: {error}"
            header = read_header(data)
        if header and (header.width_px, header.height_px) != self._image_size:
            problem = f"is {header.width_px}x{header.height_px}, not as the first"
        if problem:
            return SourceEvent(timestamp_ns, "warning", f"frame {index} {problem}", dropped=1)
        return CapturedFrame(index, timestamp_ns, arrival_ns, data, format)

    def _first_image(
        self, reader: AnyReader, connections: list[Connection]
    ) -> tuple[Any, tuple[int, int]]:
        """The first message with an image in it, and its size."""
        for number, entry in enumerate(self._messages(reader, connections)):
            if isinstance(entry, str):
                raise InputError(self._path, f"expected images, found: {entry}", self._topic)
            _, message = entry
            if message is None:
                continue
            if not self._compressed:
                self._check_encoding(message.encoding)
                return message, (message.width, message.height)
            if header := read_header(message.data[: 1 << 20].tobytes()):
                return message, (header.width_px, header.height_px)
            if number >= _UNREADABLE_AT_START:
                break
        raise InputError(
            self._path, "expected JPEG, PNG or WebP images, found none that can be read",
            self._topic,
        )  # fmt: skip

    def _check_encoding(self, encoding: str) -> None:
        if not pixels.known_encoding(encoding):
            raise InputError(
                self._path, f"expected grey, colour or Bayer images, found {encoding}", self._topic
            )
        if self._encoding == "jpeg" and pixels.is_deep(encoding):
            raise InputError(self._path, f"expected --encoding png for {encoding}, found jpeg")

    def _calibration_of(self, reader: AnyReader, frame_id: str) -> bytes | None:
        """A camera.yaml from the first CameraInfo beside the images; None with a warning."""
        topic = info_topic(self._topic)
        found = [c for c in reader.connections if c.topic == topic and c.msgcount]
        if not found or found[0].msgtype != bag.CAMERA_INFO:
            return None
        entry = next(self._messages(reader, found), "no message")
        try:
            if isinstance(entry, str) or entry[1] is None:
                raise ValueError("its message cannot be read")
            camera = camera_of(
                entry[1],
                ros1=not reader.is2,
                rectified=is_rectified(self._topic),
                name=frame_id or "camera",
            )
            if camera.image_size != self._image_size:
                raise ValueError(
                    f"it is for {camera.width_px}x{camera.height_px}, the images are "
                    f"{self._image_size[0]}x{self._image_size[1]}"
                )
        except ValueError as error:
            self._warnings.append(f"no calibration from {topic}: {error}")
            return None
        return camera_yaml(camera)


def _named_format(text: str) -> str:
    """The format that a CompressedImage claims, such as `bgr8; png compressed bgr8`."""
    return "png" if "png" in text.lower() else "jpeg"
