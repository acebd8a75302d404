"""What a person may set on a camera."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Literal

Auto = Literal["auto"]

_UNITS_US = {"s": Fraction(10**6), "ms": Fraction(1000), "us": Fraction(1)}


@dataclass(frozen=True)
class CameraSettings:
    """None leaves it to the camera.

    Attributes:
        size: width and height in pixels.
        rate_hz: frames a second.
        exposure_us: microseconds.
        focus: in the camera's own numbers, mostly 0 for far.
        white_balance_k: kelvin.
    """

    size: tuple[int, int] | None = None
    rate_hz: Fraction | None = None
    exposure_us: int | Auto | None = None
    focus: int | Auto | None = None
    white_balance_k: int | Auto | None = None

    def given(self) -> list[str]:
        """The options that were given, as they are called on the command line."""
        names = {"rate_hz": "rate", "exposure_us": "exposure", "white_balance_k": "white-balance"}
        found = [f.name for f in fields(self) if getattr(self, f.name) is not None]
        return [names.get(name, name) for name in found]


def parse_size(text: str) -> tuple[int, int]:
    """Width and height from `1920x1080`.

    Raises:
        ValueError: it is not such a text.
    """
    match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if not match:
        raise ValueError(f"expected a size such as 1920x1080, found {text!r}")
    return int(match[1]), int(match[2])


def parse_rate(text: str) -> Fraction:
    """Frames a second from `30` or `30000/1001`.

    Raises:
        ValueError: it is not a rate above 0.
    """
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if rate <= 0:
        raise ValueError(f"expected a rate above 0, found {text!r}")
    return rate


def parse_exposure(text: str) -> int | Auto:
    """Microseconds from `5ms`, `500us`, `0.01s` or `1/200s`; or `auto`.

    Raises:
        ValueError: it is none of them.
    """
    if text == "auto":
        return "auto"
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\d+/[1-9]\d*)\s*(us|ms|s)", text)
    exposure_us = round(Fraction(match[1]) * _UNITS_US[match[2]]) if match else 0
    if exposure_us < 1:
        raise ValueError(f"expected a time such as 5ms, 500us or 1/200s, or auto, found {text!r}")
    return exposure_us


def parse_number_or_auto(text: str) -> int | Auto:
    """A whole number, or `auto`.

    Raises:
        ValueError: it is neither.
    """
    if text == "auto":
        return "auto"
    if not text.isdecimal():
        raise ValueError(f"expected a whole number or auto, found {text!r}")
    return int(text)
