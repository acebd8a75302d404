"""An MCAP file that is being written: chunks that close in time, and always room for its end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from recorder.log.log_file import DiskFullError, LogFile, RawFile

if TYPE_CHECKING:
    from google.protobuf.message import Message as ProtobufMessage

_CHUNK_BYTES = 1 << 20
_CHUNK_NS = 500_000_000
# What the end of a file takes beside its open chunk: repeated channels, and an index per chunk.
_SUMMARY_BYTES = 64 << 10
_SUMMARY_BYTES_PER_CHUNK = 256
_MESSAGE_BYTES = 64


class McapOutput:
    """Chunks of at most 1 MiB (and one message) or half a second of log time, CRCs, uncompressed.

    Log time and not the clock closes chunks, unless `flush` is called: the same messages give the
    same bytes.
    Each method may raise DiskFullError: what it was given is not in the file then, unless `full`.
    """

    def __init__(self, raw: RawFile, folder: Path) -> None:
        self._file = LogFile(raw, folder)
        self._writer = Writer(
            self._file,  # type: ignore[arg-type]  # it asks for write, tell and flush
            chunk_size=_CHUNK_BYTES,
            compression=CompressionType.NONE,
            enable_data_crcs=True,
        )
        self._channels: dict[str, int] = {}
        self._copied: dict[int, int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._summary_bytes = _SUMMARY_BYTES
        self._pending_bytes = 0
        self._pending: Counter[str] = Counter()
        self._chunks = 0
        self._chunk_start_ns: int | None = None
        self._broken = False
        with self._whole():
            self._writer.start(profile="", library="arucolog")

    @property
    def full(self) -> bool:
        """The disk is full: only `finish` still fits."""
        return self._file.full

    @property
    def bytes_written(self) -> int:
        return self._file.tell()

    @property
    def bytes_ahead(self) -> int:
        """What the file would have, at most, if it were finished now."""
        return self._file.tell() + self._pending_bytes + self._summary()

    @property
    def has_open_chunk(self) -> bool:
        """There are messages that are not in the file yet."""
        return self._chunk_start_ns is not None

    def open_messages(self, topic: str) -> int:
        """Messages that are not in the file yet or, once it is closed, could not be put there."""
        return self._pending[topic]

    def flush(self) -> None:
        """Close the open chunk."""
        if self.has_open_chunk and not self._broken:
            self._close_chunk()

    def sync(self) -> None:
        """Wait until what is in the file is on the disk; from any thread.

        Raises:
            OSError: it could not be put there.
        """
        self._file.sync()

    def is_at(self, path: Path) -> bool:
        """Whether `path` still is the file that is being written."""
        return self._file.is_at(path)

    def add_attachment(self, time_ns: int, name: str, media_type: str, data: bytes) -> None:
        self._reserve(len(data) + 1024)
        with self._whole():
            self._writer.add_attachment(time_ns, time_ns, name, media_type, data)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        self._reserve(4 * sum(len(k) + len(v) for k, v in values.items()) + 1024)
        with self._whole():
            self._writer.add_metadata(name, dict(values))

    def write(
        self,
        topic: str,
        message: ProtobufMessage,
        log_time: int,
        publish_time: int,
        sequence: int = 0,
    ) -> None:
        if topic not in self._channels:
            schema_id = register_schema(self._writer, type(message))
            self._summary_bytes += 4096
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema_id)
        data = message.SerializeToString()
        self._add(topic, self._channels[topic], data, log_time, publish_time, sequence)

    def copy(self, schema: Schema | None, channel: Channel, message: Message) -> None:
        """A message of another file as it is."""
        if channel.id not in self._copied:
            schema_id = self._copy_schema(schema) if schema is not None else 0
            self._copied[channel.id] = self._writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
        stamps = (message.log_time, message.publish_time, message.sequence)
        self._add(channel.topic, self._copied[channel.id], message.data, *stamps)

    def finish(self, name: str, values: Mapping[str, str]) -> None:
        """A last metadata record, index and footer.

        Without space even for them (someone else took it) the file stays without: its chunks are
        whole, and a reader says that it was cut short.
        """
        self._file.release()
        if self._broken:
            return
        try:
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._pending.clear()
            self._writer.add_metadata(name, dict(values))
            self._writer.finish()  # type: ignore[no-untyped-call]
        except DiskFullError:
            self._broken = True

    def close(self) -> None:
        self._file.close()

    def _add(
        self,
        topic: str,
        channel_id: int,
        data: bytes,
        log_time: int,
        publish_time: int,
        sequence: int,
    ) -> None:
        start_ns = self._chunk_start_ns
        # A clock that was set back closes it as well.
        if start_ns is not None and abs(log_time - start_ns) >= _CHUNK_NS:
            self._close_chunk()
        self._reserve(len(data) + _MESSAGE_BYTES)
        if self._chunk_start_ns is None:
            self._chunk_start_ns = log_time
        before = self._file.tell()
        with self._whole():
            self._writer.add_message(channel_id, log_time, data, publish_time, sequence)
        self._pending_bytes += len(data) + _MESSAGE_BYTES
        self._pending[topic] += 1
        if self._file.tell() != before:
            self._chunk_closed()

    def _close_chunk(self) -> None:
        with self._whole():
            self._writer.flush()  # type: ignore[no-untyped-call]
        self._chunk_closed()

    def _chunk_closed(self) -> None:
        self._chunks += 1
        self._pending_bytes = 0
        self._chunk_start_ns = None
        if not self._broken:
            self._pending.clear()

    def _copy_schema(self, schema: Schema) -> int:
        key = (schema.name, schema.encoding, schema.data)
        if key not in self._schemas:
            self._summary_bytes += 2 * len(schema.data) + 1024
            self._schemas[key] = self._writer.register_schema(*key)
        return self._schemas[key]

    def _reserve(self, more: int) -> None:
        self._file.ensure(self._pending_bytes + more + self._summary())

    def _summary(self) -> int:
        return self._summary_bytes + _SUMMARY_BYTES_PER_CHUNK * (self._chunks + 2)

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """A write that fails half-way leaves mcap's writer without what it believes is written."""
        try:
            yield
        except BaseException:
            self._broken = True
            raise
