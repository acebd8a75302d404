"""Sizes and durations as people write them: 500MB, 1GB, 90s, 10min."""

from __future__ import annotations

import math
import re

import click

_QUANTITY = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([a-zA-Z]+)\s*")
_BYTES = {"b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12}
_BYTES |= {"kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40}
_SECONDS = {"s": 1, "sec": 1, "min": 60, "h": 3600}


def parse_size(text: str) -> int:
    """Bytes.

    Raises:
        ValueError: not a number with a unit.
    """
    return round(_parse(text, _BYTES, "a size such as 500MB or 1GB"))


def parse_duration(text: str) -> float:
    """Seconds.

    Raises:
        ValueError: not a number above 0 with a unit.
    """
    expected = "a duration such as 90s or 10min"
    seconds = _parse(text, _SECONDS, expected)
    if seconds <= 0:
        raise ValueError(f"expected {expected}, found {text!r}")
    return seconds


def size_text(size: int) -> str:
    """Bytes in the unit that suits."""
    if size < 1000:
        return f"{size} B"
    for unit, scale in (("kB", 1e3), ("MB", 1e6), ("GB", 1e9)):
        if size < 1000 * scale or unit == "GB":
            return f"{size / scale:.1f} {unit}"
    return ""


class Size(click.ParamType[int]):
    """An option that is a size in bytes."""

    name = "size"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> int:
        if isinstance(value, int):
            return value
        try:
            return parse_size(str(value))
        except ValueError as error:
            self.fail(str(error), param, ctx)


class Duration(click.ParamType[float]):
    """An option that is a duration in seconds."""

    name = "duration"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        if isinstance(value, float):
            return value
        try:
            return parse_duration(str(value))
        except ValueError as error:
            self.fail(str(error), param, ctx)


def _parse(text: str, units: dict[str, int], expected: str) -> float:
    match = _QUANTITY.fullmatch(text)
    scale = units.get(match[2].lower()) if match else None
    if match is None or scale is None or not math.isfinite(float(match[1])):
        raise ValueError(f"expected {expected}, found {text!r}")
    return float(match[1]) * scale
