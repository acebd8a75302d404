"""What `arucolog track` says while it runs and at the end."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from recorder.record_text import counts_text

if TYPE_CHECKING:
    from replay.live.track import TrackStatus
    from replay.live.tracking import Situation


def status_text(status: TrackStatus) -> str:
    """One line, beside the number of frames and their rate."""
    parts = [counts_text(status.recording)]
    if math.isfinite(status.latency.median_ms):
        parts.append(f"latency {status.latency}")
    return ", ".join(parts)


def situation_text(now: Situation) -> str:
    """One line on where the robot is."""
    parts = [now.status, f"{now.n_used} markers"]
    if math.isfinite(now.x_m):
        parts.append(f"x {now.x_m:.3f} y {now.y_m:.3f} m")
    if math.isfinite(now.yaw_rad):
        parts.append(f"yaw {math.degrees(now.yaw_rad):.1f}°")
    return ", ".join(parts)


def latency_text(latency_ms: dict[str, Any]) -> str:
    """One line on the whole run."""
    values = ", ".join(f"{key} {latency_ms[key]:.1f}" for key in ("median", "p95", "max"))
    return f"latency from {latency_ms['from']} to track, ms: {values} ({latency_ms['clock']})"
