"""Other clocks than the system's, and how their stamps become system time."""

from __future__ import annotations

import time
from typing import NamedTuple

ARRIVAL = "arrival (system clock)"

# A stamp this far from the frame's arrival is of another clock, or of one that nobody has set.
_PLAUSIBLE_NS = 5 * 10**9


class KernelClock(NamedTuple):
    """The clock of the stamps that a driver puts on frames.

    Attributes:
        offset_ns: what turns its stamps into system time.
    """

    name: str
    offset_ns: int


def kernel_clock(stamp_ns: int) -> KernelClock | None:
    """The clock of a stamp that is no older than a few seconds; None if it is no known one.

    The offset holds for a connection: when the system clock is set in between, the intervals
    between frames stay true.
    """
    if near(stamp_ns, time.monotonic_ns()):
        name = "kernel (v4l2, CLOCK_MONOTONIC converted to system time)"
        return KernelClock(name, time.time_ns() - time.monotonic_ns())
    if near(stamp_ns, time.time_ns()):
        return KernelClock("kernel (v4l2, CLOCK_REALTIME)", 0)
    return None


def near(stamp_ns: int, now_ns: int) -> bool:
    """Whether a stamp can be of a clock that shows `now_ns`."""
    return abs(stamp_ns - now_ns) <= _PLAUSIBLE_NS
