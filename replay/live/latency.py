"""How long frames take from their capture to their track."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from replay.viewer.thinning import Thinned

# What "just now" means on screen.
_RECENT_S = 5.0


@dataclass(frozen=True)
class Latency:
    """Milliseconds; NaN where there was no frame."""

    median_ms: float
    p95_ms: float
    max_ms: float

    @classmethod
    def of(cls, values_ms: npt.NDArray[np.float64], max_ms: float | None = None) -> Latency:
        if not len(values_ms):
            return cls(math.nan, math.nan, math.nan)
        median, p95 = np.percentile(values_ms, [50.0, 95.0]).tolist()
        return cls(median, p95, float(values_ms.max()) if max_ms is None else max_ms)

    def as_dict(self) -> dict[str, Any]:
        values = {"median": self.median_ms, "p95": self.p95_ms, "max": self.max_ms}
        return {key: round(value, 3) for key, value in values.items() if math.isfinite(value)}

    def __str__(self) -> str:
        return f"{self.median_ms:.0f}/{self.p95_ms:.0f}/{self.max_ms:.0f} ms"


class Latencies:
    """Those of all frames (of very many, evenly spaced ones) and of the last seconds."""

    def __init__(self) -> None:
        self._all = Thinned(1)
        self._max_ms = 0.0
        self._recent: deque[tuple[float, float]] = deque()

    def add(self, latency_ms: float) -> None:
        self._all.add(latency_ms)
        self._max_ms = max(self._max_ms, latency_ms)
        now = time.monotonic()
        self._recent.append((now, latency_ms))
        while now - self._recent[0][0] > _RECENT_S:
            self._recent.popleft()

    def overall(self) -> Latency:
        return Latency.of(self._all.rows()[:, 0], self._max_ms)

    def recent(self) -> Latency:
        """Of the last seconds before the last frame; from any thread."""
        return Latency.of(np.array([latency for _, latency in tuple(self._recent)]))
