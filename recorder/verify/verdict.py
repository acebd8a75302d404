"""What a rule says of a log."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Level = Literal["ok", "warning", "failed"]


@dataclass(frozen=True)
class Verdict:
    """One rule's; `text` is one line."""

    rule: str
    level: Level
    text: str


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


def ok(rule: str, text: str) -> Verdict:
    return Verdict(rule, "ok", text)


def warning(rule: str, text: str) -> Verdict:
    return Verdict(rule, "warning", text)


def failed(rule: str, text: str) -> Verdict:
    return Verdict(rule, "failed", text)
