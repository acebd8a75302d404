"""Messages for the event list where a replay's status changes."""

from __future__ import annotations

from pipeline.localizer import FrameResult
from pipeline.pose import PoseFix


class StatusEvents:
    """Says when fixes stop, why, and when they come back."""

    def __init__(self, result_name: str) -> None:
        self._name = result_name
        self._status: str | None = None
        self._since = 0
        self._count = 0
        self._fallback = False

    def changes(self, result: FrameResult) -> list[tuple[str, str]]:
        """Level and message of what this frame changes; mostly nothing."""
        fix, events = result.fix, []
        if fix.status != self._status:
            if fix.status != "ok":
                text = f"frame {result.frame_index}: {fix.status}: {_reason(fix)}"
                events.append(("WARN", f"{self._name}: {text}"))
            elif self._status is None:
                events.append(("INFO", f"{self._name}: first fix at frame {result.frame_index}"))
            else:
                frames = "1 frame" if self._count == 1 else f"{self._count} frames"
                text = f"frame {result.frame_index}: ok again after {frames} of {self._status}"
                events.append(("INFO", f"{self._name}: {text}"))
            self._status, self._count = fix.status, 0
        self._count += 1
        if fix.fallback and not self._fallback and fix.status == "ok":
            text = f"frame {result.frame_index}: RANSAC failed, solved without it"
            events.append(("INFO", f"{self._name}: {text}"))
        self._fallback = fix.fallback
        return events


def _reason(fix: PoseFix) -> str:
    """Why a frame gives no fix, in words."""
    markers = "marker" if fix.n_used == 1 else "markers"
    reasons = {
        "no_markers": "nothing detected",
        "unknown_ids": f"none of {fix.n_detected} detected markers is in the map",
        "duplicate_ids": "only ids that were seen twice",
        "solver_failed": f"no pose from {fix.n_used} {markers}",
        "non_finite": f"the pose from {fix.n_used} {markers} is not finite",
        "behind_markers": "the pose sees the markers from behind",
        "reprojection": f"the pose explains {fix.n_explained} of {fix.n_used} {markers}",
        "undecodable": "the image cannot be decoded",
    }
    return reasons.get(fix.status, "no pose")
