"""Keeps a camera that fails ten thousand times from filling the log with as many lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_BURST = 5
_PERIOD_NS = 1_000_000_000
_NUMBERS = re.compile(r"\d+(\.\d+)?")


@dataclass
class _Kind:
    since_ns: int
    written: int = 0
    left_out: int = 0
    last: str = ""


class EventLimiter:
    """Lets five events of a kind a second through and counts the others.

    A kind is a text without its numbers. Seconds are those of the log: the same events give the
    same log.
    """

    def __init__(self) -> None:
        self._kinds: dict[str, _Kind] = {}

    def admit(self, time_ns: int, text: str) -> tuple[bool, str | None]:
        """Whether to write this one; and what to write about those left out before it."""
        name = _NUMBERS.sub("#", text)
        kind = self._kinds.setdefault(name, _Kind(time_ns))
        said = None
        if abs(time_ns - kind.since_ns) >= _PERIOD_NS:
            said = _about(kind)
            self._kinds[name] = kind = _Kind(time_ns)
        if kind.written < _BURST:
            kind.written += 1
            return True, said
        kind.left_out += 1
        kind.last = text
        return False, said

    def rest(self) -> Iterator[str]:
        """What is still to be said at the end, once."""
        for kind in self._kinds.values():
            if (said := _about(kind)) is not None:
                yield said
        self._kinds.clear()


def _about(kind: _Kind) -> str | None:
    return f"{kind.left_out} more like this: {kind.last}" if kind.left_out else None
