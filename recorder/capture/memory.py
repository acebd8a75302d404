"""Memory that is used again instead of being asked for again."""

from __future__ import annotations

import ctypes
import sys

# Of malloc.h.
_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3


def keep_freed_memory() -> None:
    """Let glibc keep blocks of up to 32 MiB that are freed, 256 MiB in all.

    Every frame is several times its size of short-lived buffers. Given back to the system each
    time, their page faults take twice as long as all the rest of writing a frame. Does nothing
    where there is no glibc.
    """
    if sys.platform != "linux":
        return
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return
    mallopt(_M_MMAP_THRESHOLD, 32 << 20)
    mallopt(_M_TRIM_THRESHOLD, 256 << 20)
