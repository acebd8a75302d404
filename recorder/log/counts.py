"""What a recording counts while it runs, and says in the log when it ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

PREFIX = "frames_"


@dataclass
class FrameCounts:
    """Frames of a log.

    Attributes:
        written: in the log, whatever is wrong with them.
        dropped: left out of the frame numbers, or announced as lost.
        late: came when nearly twice the usual time had passed; of live sources only.
        corrupt: not whole images, or not of the size of the others.
        inspected: looked into; of the others only the header and the end.
        stamped_back: captured, as it seems, before the frame before them.
    """

    written: int = 0
    dropped: int = 0
    late: int = 0
    corrupt: int = 0
    inspected: int = 0
    stamped_back: int = 0

    def __add__(self, other: FrameCounts) -> FrameCounts:
        mine, more = asdict(self), asdict(other)
        return FrameCounts(**{name: mine[name] + more[name] for name in mine})

    def as_metadata(self) -> dict[str, str]:
        return {f"{PREFIX}{name}": str(value) for name, value in asdict(self).items()}


def said_counts(end: Mapping[str, str]) -> dict[str, int]:
    """The counts in a session_end record; of those that are no numbers, none."""
    names = [f"{PREFIX}{name}" for name in asdict(FrameCounts())] + ["display_dropped", "events"]
    return {name: int(end[name]) for name in names if end.get(name, "").isdecimal()}
