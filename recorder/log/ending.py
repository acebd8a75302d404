"""How a log ended: the words that are in it, and what they mean to people."""

from __future__ import annotations

from recorder.log.log_file import DiskFullError

COMPLETE = "complete"
INTERRUPTED = "interrupted"
DISK_FULL = "disk_full"
_ERROR = "error: "


def after(error: BaseException) -> str:
    """The ending of a recording that this exception stopped."""
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, DiskFullError):
        return DISK_FULL
    return f"{_ERROR}{str(error) or type(error).__name__}"


def shortfall(ended: str) -> str | None:
    """Why there is less in a log than was to be recorded; None where there is not.

    One that its operator interrupted is whole.
    """
    if ended in (COMPLETE, INTERRUPTED):
        return None
    if ended == DISK_FULL:
        return "cut short when it was recorded: the disk was full"
    if ended.startswith(_ERROR):
        return f"cut short when it was recorded: {ended.removeprefix(_ERROR)}"
    return ended
