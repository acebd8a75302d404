"""What a check has to say, and how bad it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, Protocol

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


class _Graded(Protocol):
    @property
    def severity(self) -> Severity: ...


@dataclass(frozen=True)
class Checked:
    """A file that was checked; the findings are those of whoever derives from it."""

    path: str

    @property
    def _graded(self) -> Sequence[_Graded]:
        raise NotImplementedError

    def count(self, severity: Severity) -> int:
        return sum(finding.severity == severity for finding in self._graded)

    @property
    def sane(self) -> bool:
        """No errors; warnings may be as the site is."""
        return self.count("error") == 0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "sane": self.sane,
            "errors": self.count("error"),
            "warnings": self.count("warning"),
            **asdict(self),
        }
