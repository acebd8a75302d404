"""The text of a file that a person names."""

from __future__ import annotations

from pathlib import Path

from mcap.writer import MCAP0_MAGIC

from recorder.errors import InputError

_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def text_of(data: bytes, path: Path) -> str:
    """UTF-8, with or without a byte order mark.

    Args:
        path: where the bytes come from, for the message.

    Raises:
        InputError: other bytes; names the line.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if data.startswith(MCAP0_MAGIC):
            raise InputError(path, "expected a text file, found an MCAP log") from error
        if data.startswith(_UTF16):
            raise InputError(path, "expected UTF-8 text, found UTF-16: save it as UTF-8") from error
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            path, f"expected UTF-8 text, found byte 0x{data[error.start]:02x}", f"line {line}"
        ) from error
