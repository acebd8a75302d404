"""How a log ended: the words that are in it, and what they mean to people."""

from __future__ import annotations

from recorder.log.log_file import DiskFullError

COMPLETE = "complete"
INTERRUPTED = "interrupted"
DISK_FULL = "disk_full"
DISK_LOW = "disk_low"
_ERROR = "error: "
_SPLIT = "split: goes on in "
_RECOVERED = "recovered: "


def after(error: BaseException) -> str:
    """The ending of a recording that this exception stopped."""
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, DiskFullError):
        return DISK_FULL
    return f"{_ERROR}{str(error) or type(error).__name__}"


def split(next_name: str) -> str:
    """The ending of a part of a recording whose next part is the file `next_name`."""
    return f"{_SPLIT}{next_name}"


def next_part(ended: str) -> str | None:
    """The name of the file in which a recording goes on; None where it does not."""
    return ended.removeprefix(_SPLIT) if ended.startswith(_SPLIT) else None


def recovered(ended: str) -> str:
    """The ending of what was saved from a log that ended so."""
    return ended if ended.startswith(_RECOVERED) else f"{_RECOVERED}{ended}"


def failed(ended: str) -> bool:
    """Whether a recording was stopped by an error, not by its end, a person or a full disk."""
    return ended.startswith(_ERROR)


def shortfall(ended: str) -> str | None:
    """Why there is less in a log than was to be recorded; None where there is not.

    One that its operator interrupted is whole.
    """
    if ended in (COMPLETE, INTERRUPTED):
        return None
    if ended == DISK_FULL:
        return "cut short when it was recorded: the disk was full"
    if ended == DISK_LOW:
        return "cut short when it was recorded: the disk was nearly full"
    if (goes_on := next_part(ended)) is not None:
        return f"one part of a recording that goes on in {goes_on}"
    if ended.startswith(_ERROR):
        return f"cut short when it was recorded: {ended.removeprefix(_ERROR)}"
    return ended
