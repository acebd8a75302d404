"""What `arucolog record` says while it runs and at the end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorder.info_text import counted, outage_text
from recorder.log import topics
from recorder.quantities import size_text

if TYPE_CHECKING:
    from recorder.capture.recording import Status
    from recorder.log.counts import FrameCounts
    from recorder.record import RecordSummary

_OPTIONS = {topics.CAMERA_FILE: "--camera", topics.MAP_FILE: "--map"}


def status_text(status: Status) -> str:
    """One line on how the recording stands, beside the number of frames and their rate."""
    parts = [
        counts_text(status),
        f"queue {status.queued_frames}",
        size_text(status.bytes_written),
        f"{size_text(status.free_bytes)} free",
    ]
    return ", ".join(parts)


def counts_text(status: Status) -> str:
    """What went wrong with frames so far; the first that a line says, as it may be cut."""
    counts = status.counts
    parts = [f"dropped {counts.dropped}", f"late {counts.late}", f"corrupt {counts.corrupt}"]
    if status.lost_s is not None:
        parts.insert(0, f"camera lost for {status.lost_s:.0f} s")
    if counts.stamped_back:
        parts.append(f"stamped back {counts.stamped_back}")
    if status.display_dropped:
        parts.append(f"not shown {status.display_dropped}")
    return ", ".join(parts)


def summary_text(summary: RecordSummary) -> str:
    """One line on the log, one on lost connections and one on what a replay will ask for."""
    if not summary.frames_written:
        return "nothing recorded"
    logs = str(summary.path)
    if len(summary.parts) > 1:
        logs += f" to {summary.parts[-1].name}"
    lines = [
        f"{logs}: {counted(summary.frames_written, 'frame')}, {summary.duration_s:.3f} s, "
        f"{size_text(summary.bytes_written)}, {_faults(summary.counts)}"
    ]
    if summary.outages.count:
        lost = summary.outages
        lines.append(outage_text(lost.count, lost.seconds, at_end=lost.at_end))
    if summary.missing:
        options = " and ".join(_OPTIONS[name] for name in summary.missing)
        lines.append(f"without {' and '.join(summary.missing)}: replay needs {options}")
    return "\n".join(lines)


def exit_code(summary: RecordSummary, *, endless: bool) -> int:
    """`endless`: it was to go on until somebody stops it, which is no failure then."""
    if summary.outages.at_end:
        return 1
    if summary.ended == "interrupted":
        return 0 if endless and summary.frames_written else 130
    return 0 if summary.ended == "complete" else 1


def ending_text(summary: RecordSummary, *, endless: bool = False) -> str | None:
    """Why the recording ended early; None where it did not."""
    if exit_code(summary, endless=endless) == 0:
        return None
    if summary.ended == "interrupted" and not summary.outages.at_end:
        return "Interrupted." + (
            " The log is complete up to here." if summary.frames_written else ""
        )
    if summary.ended == "disk_full":
        return f"Error: {summary.parts[-1]}: the disk is full; the log is complete up to here"
    if summary.ended == "disk_low":
        return (
            f"Error: {summary.parts[-1]}: the disk is nearly full (--min-free); the log is "
            "complete up to here"
        )
    if summary.ended == "failed":
        return f"Error: {summary.problem}"
    if summary.outages.at_end:
        return "Error: the camera was lost; the log is complete up to then"
    return None


def _faults(counts: FrameCounts) -> str:
    """The dropped always: that there are none is what one wants to read."""
    parts = [f"{counts.dropped} dropped"]
    others = {
        "late": counts.late,
        "corrupt": counts.corrupt,
        "with a stamp that jumps back": counts.stamped_back,
    }
    parts += [f"{n} {what}" for what, n in others.items() if n]
    if 0 < counts.inspected < counts.written:
        parts.append(f"{counts.inspected} decoded to look for damage")
    return ", ".join(parts)
