"""What a rule says of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

Level = Literal["ok", "warning", "failed"]
Value = float | Sequence[int]


@dataclass(frozen=True)
class Verdict:
    """One rule's; `text` is one line, `values` are the numbers in it, for programs."""

    rule: str
    level: Level
    text: str
    values: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class LogVerdict:
    """All rules', of one recording."""

    logs: tuple[str, ...]
    rules: tuple[Verdict, ...]

    @property
    def level(self) -> Level:
        """The worst of them."""
        levels = {verdict.level for verdict in self.rules}
        return "failed" if "failed" in levels else "warning" if "warning" in levels else "ok"

    def count(self, level: Level) -> int:
        return sum(verdict.level == level for verdict in self.rules)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "logs": list(self.logs),
            "verdict": self.level,
            "failed": self.count("failed"),
            "warnings": self.count("warning"),
            "rules": [asdict(verdict) for verdict in self.rules],
        }


def ok(rule: str, text: str, **values: Value) -> Verdict:
    return Verdict(rule, "ok", text, values)


def warning(rule: str, text: str, **values: Value) -> Verdict:
    return Verdict(rule, "warning", text, values)


def failed(rule: str, text: str, **values: Value) -> Verdict:
    return Verdict(rule, "failed", text, values)
