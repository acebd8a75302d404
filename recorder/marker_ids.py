"""Marker ids as people write them: `0-23,30`."""

from __future__ import annotations

# No dictionary of cv2.aruco goes further than DICT_APRILTAG_36h10.
MOST = 2319
_DIGITS = 9


def parse_ids(text: str) -> tuple[int, ...]:
    """Ids in the order given.

    Raises:
        ValueError: not of that form, an id twice, or one that is in no dictionary.
    """
    ids: dict[int, None] = {}
    for part in text.split(","):
        first, dash, last = (piece.strip() for piece in part.strip().partition("-"))
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise ValueError(f"expected ids such as 0-23,30, found {text!r}")
        # Thousands of digits are more than int takes.
        if max(len(first), len(last)) > _DIGITS or int(last or first) > MOST:
            raise ValueError(f"expected ids up to {MOST}, found {part.strip()!r}")
        low, high = int(first), int(last or first)
        if high < low:
            raise ValueError(f"expected the lower id first, found {part.strip()!r}")
        for number in range(low, high + 1):
            if number in ids:
                raise ValueError(f"expected each id once, found {number} twice")
            ids[number] = None
    return tuple(ids)
