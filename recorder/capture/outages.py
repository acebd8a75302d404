"""How often and how long a live source was gone while it was recorded."""

from __future__ import annotations

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Outages:
    """
    Attributes:
        count: how often the connection was lost.
        seconds: without a frame because of that, in all.
        at_end: it was not back when the recording ended.
    """

    count: int = 0
    seconds: float = 0.0
    at_end: bool = False

    def as_metadata(self) -> dict[str, str]:
        return {
            "connection_lost": str(self.count),
            "connection_lost_s": f"{self.seconds:.1f}",
            "connection_lost_at_end": "yes" if self.at_end else "no",
        }


class OutageClock:
    """Adds up outages while they happen."""

    def __init__(self) -> None:
        self._count = 0
        self._seconds = 0.0
        self._since_s: float | None = None

    def tell(self, *, connected: bool, silent_s: float) -> None:
        """The connection was lost, or is back, when nothing had come for `silent_s`."""
        if connected:
            self._seconds += silent_s
            self._since_s = None
        elif self._since_s is None:
            self._count += 1
            self._since_s = time.monotonic() - silent_s

    @property
    def lasts_s(self) -> float | None:
        """For how long nothing has come over a lost connection; None while there is one."""
        since_s = self._since_s
        return None if since_s is None else time.monotonic() - since_s

    @property
    def outages(self) -> Outages:
        """Up to now."""
        if self._since_s is None:
            return Outages(self._count, self._seconds, at_end=False)
        return Outages(self._count, self._seconds + time.monotonic() - self._since_s, at_end=True)
