"""What kind of recording a path is, and which of its topics are images."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mcap.records import Header
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from recorder.errors import InputError
from recorder.sources.bags.faults import bag_fault, reason
from recorder.sources.images import IMAGE_SUFFIXES

COMPRESSED = "sensor_msgs/msg/CompressedImage"
RAW = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"


def is_bag(path: Path) -> bool:
    """Whether a path has the looks of a ROS bag; our own logs are none."""
    if path.is_dir():
        has_images = any(p.suffix.lower() in IMAGE_SUFFIXES for p in path.iterdir())
        return _describes_bag(path / "metadata.yaml") or (any(_storages(path)) and not has_images)
    return _is_storage(path) or path.name.lower().endswith((".bag", ".bag.active"))


@contextmanager
def open_bag(path: Path) -> Iterator[AnyReader]:
    """The bag, with the message types of ROS 2's latest release where it brings none.

    Raises:
        InputError: it is none, or is damaged.
    """
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise InputError(
            path, "expected a ROS 2 bag with its metadata.yaml, found none (ros2 bag reindex "
            "makes it; a single .mcap or .db3 file in it can be recorded too)",
        )  # fmt: skip
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except Exception as error:  # rosbags lets through what sqlite3, YAML and MCAP trip over
        files = list(_storages(path)) if path.is_dir() else [path]
        if fault := bag_fault(files, error):
            raise fault from error
        expected, hint = "a ROS bag", ""
        if path.suffix.lower() == ".mcap":
            expected = "an MCAP of ROS 2 (messages in CDR)"
            hint = "; one with foxglove.CompressedImage on /camera/image is a log: replay it"
        raise InputError(path, f"expected {expected}, found: {reason(error)}{hint}") from error
    try:
        yield reader
    finally:
        reader.close()


def image_topic(reader: AnyReader, path: Path, wanted: str | None) -> list[Connection]:
    """The connections of the topic to record.

    Raises:
        InputError: it is not there or has no images, or there are several and none is wanted.
    """
    topics: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        if connection.topic.endswith("/compressedDepth"):
            continue
        if connection.msgtype in (COMPRESSED, RAW) and connection.msgcount:
            topics.setdefault(connection.topic, []).append(connection)
    listed = ", ".join(sorted(topics)) or "none"
    if wanted is not None:
        if wanted in topics:
            return topics[wanted]
        raise InputError(path, f"expected images on {wanted}, found them on: {listed}", "--topic")
    if not topics:
        found = ", ".join(sorted({c.msgtype for c in reader.connections})) or "no messages"
        raise InputError(path, f"expected a topic with images, found none ({found})")
    if len(topics) > 1:
        raise InputError(path, f"expected --topic, one of: {listed}")
    return next(iter(topics.values()))


def kind_of(path: Path) -> str:
    """Version of ROS and storage, for the log."""
    if path.suffix.lower() == ".bag":
        return "ROS 1"
    storage = next(_storages(path), path) if path.is_dir() else path
    return "ROS 2, mcap" if storage.suffix == ".mcap" else "ROS 2, sqlite3"


def _describes_bag(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096)
    except OSError:
        return False


def _storages(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.iterdir()) if _is_storage(path))


def _is_storage(path: Path) -> bool:
    """Whether a file can hold the messages of a ROS 2 bag, were it whole."""
    if path.suffix.lower() != ".mcap":
        return path.suffix.lower() == ".db3"
    try:
        with path.open("rb") as file:
            header = next(StreamReader(file).records, None)
    except Exception:  # the reader lets everything through that it trips over
        return True
    return not isinstance(header, Header) or header.library != "arucolog"
