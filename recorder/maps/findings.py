"""What a check of a map has to say, and how bad it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# An error makes poses wrong or the map unreadable; a warning is most likely a slip of the tape
# measure or the keyboard; a note is good to know.
Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing about a map.

    Attributes:
        check: which check found it, one word such as `overlap`.
        ids: the markers it is about; none where it is about the whole map.
        text: one line.
    """

    severity: Severity
    check: str
    ids: tuple[int, ...]
    text: str
