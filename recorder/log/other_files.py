"""Recordings of ROS that are given where a log belongs."""

from __future__ import annotations

import shlex
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.writer import MCAP0_MAGIC

from recorder.errors import InputError
from recorder.log import topics

_ROS1 = b"#ROSBAG "
_PROFILES = (b"ros1", b"ros2")
# Opcode, length of the record, length of the profile's name, which is the first thing in it.
_HEADER = struct.Struct("<BQI4s")


def not_a_log(path: Path, magic: bytes) -> InputError:
    """For a file that begins with the eight bytes of `magic`, or fewer."""
    if magic == _ROS1 or path.suffix.lower() == ".db3":
        return _bag(path)
    found = f"a file that starts with {magic!r}" if magic else "an empty file"
    return InputError(path, f"expected an MCAP log, found {found}")


def check_no_bag(path: Path, file: BinaryIO, channels: Iterable[Channel]) -> None:
    """Nothing for an MCAP that is not ROS's, or that has images of ours all the same.

    Args:
        channels: those that the file's end lists, if it has one.

    Raises:
        InputError: it is a bag.
    """
    if any(c.topic == topics.IMAGE and c.message_encoding == "protobuf" for c in channels):
        return
    file.seek(len(MCAP0_MAGIC))
    head = file.read(_HEADER.size)
    if len(head) < _HEADER.size:
        return
    opcode, _, length, profile = _HEADER.unpack(head)
    if opcode == Opcode.HEADER and length == len(profile) and profile in _PROFILES:
        raise _bag(path)


def _bag(path: Path) -> InputError:
    return InputError(
        path, "expected a log, found a ROS bag: "
        f"`arucolog record {shlex.quote(str(path))} -o LOG.mcap` makes one of it "
        "(--topic where it has several of images)",
    )  # fmt: skip
