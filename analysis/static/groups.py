"""Groups of markers to compare: the map's tags, or the distance from the image centre."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.markers import MarkerMap

RINGS = ("inner", "outer")
# Without rings in the map: thirds of the markers by distance from the image centre.
THIRDS = ("near the centre", "halfway", "far from the centre")

_ROTATION = re.compile(r"rot(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class Group:
    """Some of the markers seen; `name` is what a table calls them."""

    name: str
    ids: tuple[int, ...]


@dataclass(frozen=True)
class Grouping:
    """The groups of one view.

    Attributes:
        rows: all, class by ring, rings, classes, other tags: each once, none empty.
        rings: the rings alone; by tag, or thirds by distance.
        ring_of, class_of: name by marker id; absent for a marker without one.
    """

    rows: tuple[Group, ...]
    rings: tuple[Group, ...]
    ring_of: Mapping[int, str]
    class_of: Mapping[int, str]
    by_tags: bool


def group(
    marker_map: MarkerMap, ids: Sequence[int], centre_distance_px: Mapping[int, float]
) -> Grouping:
    """The groups of the markers `ids`.

    Args:
        centre_distance_px: by id; makes the rings where the map has no `inner` and `outer`.
    """
    tags = {i: marker_map.by_id[i].tags for i in ids}
    ring_of = {i: tag for i in ids for tag in tags[i] if tag in RINGS}
    by_tags = bool(ring_of)
    ring_names: tuple[str, ...] = RINGS
    if not by_tags:
        ring_names = THIRDS
        order = sorted(ids, key=lambda i: (centre_distance_px[i], i))
        for name, third in zip(THIRDS, np.array_split(np.array(order), 3), strict=True):
            ring_of |= {int(i): name for i in third}
    class_of = {i: found for i in ids for tag in tags[i] if (found := rotation_class(tag))}
    class_names = sorted(set(class_of.values()), key=_degrees, reverse=True)
    others = sorted(
        {t for i in ids for t in tags[i] if t not in RINGS and rotation_class(t) is None}
    )

    def where(name: str, **of: str) -> Group:
        found = [
            i
            for i in ids
            if of.get("ring") in (None, ring_of.get(i))
            and of.get("rotation") in (None, class_of.get(i))
            and (of.get("tag") is None or of["tag"] in tags[i])
        ]
        return Group(name, tuple(found))

    crossed = [
        where(f"{rotation} ({ring})", ring=ring, rotation=rotation)
        for rotation in class_names
        for ring in ring_names
    ]
    rings = [where(ring, ring=ring) for ring in ring_names]
    classes = [where(rotation, rotation=rotation) for rotation in class_names]
    tagged = [where(tag, tag=tag) for tag in others]
    rows = (Group("all", tuple(ids)), *crossed, *rings, *classes, *tagged)
    return Grouping(
        tuple(g for g in rows if g.ids),
        tuple(g for g in rings if g.ids),
        ring_of,
        class_of,
        by_tags,
    )


def rotation_class(tag: str) -> str | None:
    """`22.5°` for the tag `rot22.5`; None for a tag that is no rotation."""
    match = _ROTATION.fullmatch(tag)
    return f"{match[1]}°" if match else None


def _degrees(name: str) -> float:
    return float(name.removesuffix("°"))
