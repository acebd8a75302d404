"""Marker ids as people write them: `0-23,30`."""

from __future__ import annotations


def parse_ids(text: str) -> tuple[int, ...]:
    """Ids in the order given.

    Raises:
        ValueError: not of that form, or an id twice.
    """
    ids: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise ValueError(f"expected ids such as 0-23,30, found {text!r}")
        low, high = int(first), int(last) if dash else int(first)
        if high < low or high - low > 10_000:
            raise ValueError(f"expected the lower id first, found {part.strip()!r}")
        ids += range(low, high + 1)
    if len(set(ids)) < len(ids):
        again = next(i for i in ids if ids.count(i) > 1)
        raise ValueError(f"expected each id once, found {again} twice")
    return tuple(ids)
