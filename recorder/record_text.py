"""What `arucolog record` says at the end."""

from __future__ import annotations

from recorder.info_text import counted, size_text
from recorder.log import topics
from recorder.record import RecordSummary

_OPTIONS = {topics.CAMERA_FILE: "--camera", topics.MAP_FILE: "--map"}


def summary_text(summary: RecordSummary) -> str:
    """One line on the log, and one on what a replay will ask for."""
    if not summary.frames_written:
        return "nothing recorded"
    lines = [
        f"{summary.path}: {counted(summary.frames_written, 'frame')}, {summary.duration_s:.3f} s, "
        f"{size_text(summary.bytes_written)}, {summary.frames_dropped} dropped"
    ]
    if summary.missing:
        options = " and ".join(_OPTIONS[name] for name in summary.missing)
        lines.append(f"without {' and '.join(summary.missing)}: replay needs {options}")
    return "\n".join(lines)


def ending_text(summary: RecordSummary) -> str | None:
    """Why the recording ended early; None where it did not."""
    if summary.ended == "interrupted":
        return "Interrupted." + (
            " The log is complete up to here." if summary.frames_written else ""
        )
    if summary.ended == "disk_full":
        return f"Error: {summary.path}: the disk is full; the log is complete up to here"
    return None
