"""Reads a log."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Self

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as ProtobufMessage
from mcap.records import Attachment, Channel, Message, Metadata, Schema, Statistics
from mcap.writer import MCAP0_MAGIC

from pipeline.camera import Camera
from pipeline.markers import MarkerMap
from recorder.errors import InputError
from recorder.files.truth_file import Truth
from recorder.log import ending, messages, topics
from recorder.log.damage import Damage, damage_text
from recorder.log.derived import Known
from recorder.log.mcap_records import DamagedError, data_records, summary_records
from recorder.log.other_files import check_no_bag, not_a_log
from recorder.log.records import ExactPose, LogEvent, LogImage, LogRecord

_SCHEMAS: dict[str, type[ProtobufMessage]] = {
    topics.IMAGE: CompressedImage,
    topics.CALIBRATION: CameraCalibration,
    topics.TRUTH_EXACT: PoseInFrame,
    topics.EVENTS: Log,
}


class LogReader:
    """One log, read in the order of the file with the memory of one chunk.

    A log that was cut short is read up to its last whole chunk; damaged pieces are left out.

    Attributes:
        attachments: name and bytes, of those before the first image.
        metadata: records by name; those behind the images too where the log has its index, else
            once `records` or `messages` has run to its end.
        start_ns: capture time of the first image, from which the seconds of the log count; None
            for a log without images. In a part of a recording, that of the first part.
        cut_short: once `records` or `messages` has run to its end: why and where the log ends
            before its end; None for one that has it.
    """

    def __init__(self, path: Path) -> None:
        """Reads up to the first image.

        Raises:
            InputError: not an MCAP log, or a topic of ours with another schema.
        """
        self.path = path
        self.cut_short: str | None = None
        self._damage: list[Damage] = []
        self.start_ns: int | None = None
        self._attachments: dict[str, bytes] = {}
        self._metadata: dict[str, dict[str, str]] = {}
        self._calibration: Camera | None = None
        self._image_count: int | None = None
        # As the log's end repeats them: the first chunk, which has them too, may be damaged.
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        with self._open() as file:
            self._read_summary(file)
            check_no_bag(path, file, self._channels.values())
        # `messages` comes by the damage again and says so.
        with self._open() as file, suppress(DamagedError):
            self._read_start(file)
        self.attachments: Mapping[str, bytes] = MappingProxyType(self._attachments)
        self.metadata: Mapping[str, Mapping[str, str]] = MappingProxyType(self._metadata)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Nothing is open between two calls."""

    def camera(self) -> Camera | None:
        """The attached camera.yaml, else the first message on /camera/calibration.

        Raises:
            InputError: it is malformed.
        """
        return self._known.camera or self._calibration

    def marker_map(self) -> MarkerMap | None:
        """The attached map.yaml.

        Raises:
            InputError: it is malformed.
        """
        return self._known.marker_map

    def truth(self) -> Truth | None:
        """The attached truth, in whichever form.

        Raises:
            InputError: it is malformed, or in another frame than the map.
        """
        return self._known.truth

    @property
    def damage(self) -> tuple[Damage, ...]:
        """The pieces that were left out; known once `records` or `messages` has run to its end."""
        return tuple(self._damage)

    @property
    def ending(self) -> str:
        """`cut_short` and `damage`, else what the log says: see `recorder.log.ending`.

        Known once `records` or `messages` has run to its end. A copy says how its original ended.
        """
        faults = [text for text in (damage_text(self._damage), self.cut_short) if text]
        said = self._metadata.get(topics.SESSION_END, {}).get("ended", ending.COMPLETE)
        return "; ".join(faults) or said

    @property
    def shortfall(self) -> str | None:
        """Why the log, or the one it was copied from, is not whole, for people; None where it is.

        Known when `ending` is.
        """
        found = [ending.shortfall(self.ending), self.missing_parts]
        return "; ".join(filter(None, found)) or None

    @property
    def missing_parts(self) -> str | None:
        """Which parts before this one are not here, in words; None for the first or only one."""
        part = self._metadata.get(topics.SESSION, {}).get(topics.PART, "1")
        if part == "1":
            return None
        return f"part {part} of a recording, without those before it"

    def image_count(self) -> int | None:
        """How many images there are; None where only a full pass can tell."""
        return self._image_count

    def sha256(self) -> str:
        """Digest of the file, in hex."""
        with self._open() as file:
            digest = hashlib.sha256(MCAP0_MAGIC)
            while block := file.read(1 << 20):
                digest.update(block)
            return digest.hexdigest()

    def records(
        self, from_s: float | None = None, to_s: float | None = None
    ) -> Iterator[LogRecord]:
        """Images, exact poses and events in the order of the file.

        Args:
            from_s: leave out what was captured before; in seconds of the log.
            to_s: leave out what was captured at this time or later.

        Raises:
            InputError: a message that is not what its schema says.
        """
        start_ns = self.start_ns or 0
        first_ns = None if from_s is None else start_ns + round(from_s * 1e9)
        end_ns = None if to_s is None else start_ns + round(to_s * 1e9)
        # A log of another make may leave `sequence` at 0: its images are numbered here.
        own = topics.SESSION in self._metadata
        images = -1
        for _, channel, message in self.messages():
            topic, time_ns = channel.topic, message.publish_time
            images += topic == topics.IMAGE
            if time_ns >= 2**63:
                raise InputError(self.path, f"expected a time before 2262, found {time_ns}", topic)
            if (first_ns is not None and time_ns < first_ns) or (
                end_ns is not None and time_ns >= end_ns
            ):
                continue
            index = message.sequence if own else images
            if topic == topics.IMAGE:
                _, data, format = messages.from_image(self._decode(CompressedImage, topic, message))
                yield LogImage(index, time_ns, message.log_time, data, format)
            elif topic == topics.TRUTH_EXACT:
                try:
                    _, _, pose = messages.from_pose_in_frame(
                        self._decode(PoseInFrame, topic, message)
                    )
                except ValueError as error:
                    raise InputError(self.path, str(error), topic) from error
                yield ExactPose(index, time_ns, pose)
            elif topic == topics.EVENTS:
                yield LogEvent(*messages.from_event(self._decode(Log, topic, message)))

    def messages(self) -> Iterator[tuple[Schema | None, Channel, Message]]:
        """Every message of every topic, undecoded, in the order of the file."""
        schemas, channels = dict(self._schemas), dict(self._channels)
        frames = 0
        self.cut_short = None
        self._damage.clear()

        def note(damage: Damage) -> None:
            self._damage.append(replace(damage, after_frames=frames))

        with self._open() as file:
            try:
                for record in data_records(file, note):
                    if isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel):
                        channels[record.id] = record
                        self._check_schema(record, schemas.get(record.schema_id))
                    elif isinstance(record, Metadata):
                        self._metadata[record.name] = record.metadata
                    elif isinstance(record, Message):
                        channel = channels.get(record.channel_id)
                        if channel is None:
                            note(Damage(file.tell(), len(record.data), "a message of no channel"))
                            continue
                        yield schemas.get(channel.schema_id), channel, record
                        frames += channel.topic == topics.IMAGE
            except DamagedError as error:
                plural = "frame" if frames == 1 else "frames"
                self.cut_short = f"cut short after {frames} {plural}: {error}"

    def other_metadata(self) -> Iterator[tuple[str, dict[str, str]]]:
        """Metadata records that are not of the session."""
        own = (topics.SESSION, topics.SESSION_END)
        return ((name, values) for name, values in self._metadata.items() if name not in own)

    @cached_property
    def _known(self) -> Known:
        return Known.parse(self._attachments, f"{self.path}: ")

    def _open(self) -> BinaryIO:
        """The file behind its magic."""
        try:
            file = self.path.open("rb")
        except FileNotFoundError as error:
            raise InputError(self.path, "expected an MCAP log, found no file") from error
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise InputError(self.path, f"expected an MCAP log, found: {reason}") from error
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            file.close()
            raise not_a_log(self.path, magic)
        return file

    def _read_start(self, file: BinaryIO) -> None:
        schemas, channels = dict(self._schemas), dict(self._channels)
        for record in data_records(file, lambda _: None):
            if isinstance(record, Attachment):
                self._attachments[record.name] = record.data
            elif isinstance(record, Metadata):
                self._metadata[record.name] = record.metadata
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
                self._check_schema(record, schemas.get(record.schema_id))
            elif isinstance(record, Message) and record.channel_id in channels:
                topic = channels[record.channel_id].topic
                if topic == topics.IMAGE:
                    said = self._metadata.get(topics.SESSION, {}).get(topics.RECORDING_START, "")
                    self.start_ns = int(said) if said.isdecimal() else record.publish_time
                    return
                if topic == topics.CALIBRATION and self._calibration is None:
                    calibration = self._decode(CameraCalibration, topic, record)
                    try:
                        self._calibration = messages.from_calibration(calibration)
                    except ValueError as error:
                        raise InputError(self.path, str(error), topic) from error

    def _read_summary(self, file: BinaryIO) -> None:
        counts: Mapping[int, int] | None = None
        for record in summary_records(file):
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = record
            elif isinstance(record, Metadata):
                self._metadata[record.name] = record.metadata
            elif isinstance(record, Statistics):
                counts = record.channel_message_counts
        if counts is not None:
            images = {c.id for c in self._channels.values() if c.topic == topics.IMAGE}
            self._image_count = sum(n for channel, n in counts.items() if channel in images)

    def _check_schema(self, channel: Channel, schema: Schema | None) -> None:
        expected = _SCHEMAS.get(channel.topic)
        if expected is None:
            return
        name = expected.DESCRIPTOR.full_name
        found = schema.name if schema is not None else "no schema"
        if found != name or channel.message_encoding != "protobuf":
            raise InputError(
                self.path,
                f"expected {name} in protobuf, found {found} in {channel.message_encoding}",
                channel.topic,
            )

    def _decode(self, kind: type[Any], topic: str, message: Message) -> Any:
        try:
            return kind.FromString(message.data)
        except DecodeError as error:
            name = kind.DESCRIPTOR.full_name
            raise InputError(self.path, f"expected {name}, found other bytes", topic) from error
