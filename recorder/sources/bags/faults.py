"""What is wrong with a bag that cannot be opened, and which tool mends it."""

from __future__ import annotations

import shlex
import struct
from collections.abc import Sequence
from pathlib import Path

from mcap.writer import MCAP0_MAGIC

from recorder.errors import InputError
from recorder.files.yaml_file import read_bytes

# By suffix: what it is, how it begins.
_STORAGES = {
    ".mcap": ("an MCAP", MCAP0_MAGIC),
    ".db3": ("an SQLite database", b"SQLite format 3\0"),
    ".bag": ("a ROS 1 bag", b"#ROSBAG V"),
}
# Of an SQLite database; no whole bag of any kind is shorter.
_HEAD_SIZE = 100


def bag_fault(files: Sequence[Path], error: Exception) -> InputError | None:
    """Why opening the bag in `files` failed with `error`; None where its files do not tell."""
    for path in files:
        try:
            head = read_bytes(path, _HEAD_SIZE)
            found = _fault(path, head, path.stat().st_size, reason(error))
        except InputError as unreadable:
            return unreadable
        if found is not None:
            return InputError(path, found)
    return None


def reason(error: Exception) -> str:
    """One line."""
    return str(error).partition("\n")[0] or type(error).__name__


def _fault(path: Path, head: bytes, size: int, said: str) -> str | None:
    suffix = path.suffix.lower()
    kind, magic = _STORAGES[suffix if suffix in _STORAGES else ".bag"]
    if not head:
        return f"expected {kind}, found an empty file"
    if not head.startswith(magic[: len(head)]):
        return f"expected {kind}, found a file that starts with {head[:8]!r}"
    if len(head) < _HEAD_SIZE:
        return f"expected {kind}, found one cut short after {size} bytes"
    quoted = shlex.quote(str(path))
    if suffix == ".mcap":
        if not _ends_with(path, size, magic):
            return (
                "expected an MCAP with its end, found one without (cut short?): "
                f"`mcap recover {quoted} -o NEW.mcap` saves what is there"
            )
    elif suffix == ".db3":
        if size < (whole := _database_size(head)):
            return (
                f"expected an SQLite database of {whole} bytes, found {size} (cut short?): "
                f"`sqlite3 {quoted} .recover | sqlite3 NEW.db3` saves what is there"
            )
    # rosbags says it of a bag that was not closed, and of one that was cut afterwards.
    elif "index" in said or suffix == ".active":
        return (
            "expected a ROS 1 bag with its index, found one without (cut short?): "
            f"`rosbag reindex {quoted}` makes it from what is there"
        )
    return None


def _ends_with(path: Path, size: int, end: bytes) -> bool:
    with path.open("rb") as file:
        file.seek(max(len(end), size - len(end)))
        return file.read() == end


def _database_size(head: bytes) -> int:
    """Bytes of a whole database by its header; 0 where that does not say."""
    page_bytes, changes, pages = struct.unpack_from(">H6xII", head, 16)
    # An older SQLite leaves the number of pages as a newer one wrote it.
    if struct.unpack_from(">I", head, 92)[0] != changes:
        return 0
    # 65536 does not fit in its field.
    return int(pages) * (65536 if page_bytes == 1 else int(page_bytes))
