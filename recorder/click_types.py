"""Kinds of options that click does not have."""

from __future__ import annotations

import math
from typing import Any

import click
from click.types import FloatParamType


class FiniteFloat(FloatParamType):
    """A number that is neither infinite nor NaN, and above `above` where that is given."""

    def __init__(self, above: float | None = None) -> None:
        self._above = above

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"expected a finite number, found {value!r}", param, ctx)
        if self._above is not None and number <= self._above:
            self.fail(f"expected a number above {self._above:g}, found {value!r}", param, ctx)
        return number
