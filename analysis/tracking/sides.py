"""The sides of a hand-measured path, and on which of them each frame is."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array
from pipeline.selection import MaxMarkers, limit_at
from recorder.files.truth_file import TruthPath
from replay.accuracy import distance_to_path

# Segments that meet at less belong to one side: a curve given by many points is one.
CORNER_DEG = 20.0

# Changing the side costs as much as this many metres, summed over frames: at a corner two sides
# are equally near, and noise alone must not move a frame from one to the other.
CHANGE_M = 1.0
_TIE_M = 1e-9


@dataclass(frozen=True, eq=False)
class Side:
    """A stretch of a path between two corners.

    Attributes:
        name: its number, and the limit on markers where limits change along the path.
        points_m: (M, 2) in map x, y.
    """

    name: str
    points_m: Array

    def named(self, limits: MaxMarkers, times_s: Array) -> Side:
        """The side with the limit that was mostly in force at its frames in its name."""
        if not isinstance(limits, tuple) or not len(times_s):
            return self
        most, _ = Counter(limit_at(limits, t) for t in times_s.tolist()).most_common(1)[0]
        return replace(self, name=f"{self.name} ({'all' if most is None else f'max {most}'})")


def corner_to_corner(path: TruthPath) -> tuple[Side, ...]:
    """The sides in the path's order, numbered from 1."""
    points = list(path.points_m) + ([path.points_m[0]] if path.closed else [])
    segments = [(a, b) for a, b in pairwise(points) if not np.array_equal(a, b)]
    stretches: list[list[Array]] = []
    for i, (start, end) in enumerate(segments):
        if i == 0 or _turn_deg(segments[i - 1], segments[i]) > CORNER_DEG:
            stretches.append([start])
        stretches[-1].append(end)
    if path.closed and len(stretches) > 1 and _turn_deg(segments[-1], segments[0]) <= CORNER_DEG:
        # The path starts in the middle of a side.
        stretches[0] = stretches.pop() + stretches[0][1:]
    return tuple(Side(str(i), np.array(points)) for i, points in enumerate(stretches, 1))


def along(sides: tuple[Side, ...], positions_m: Array) -> npt.NDArray[np.int64]:
    """(N,) the side of each position (N, 2), as the sequence of least cost (Viterbi).

    A frame costs its distance to its side, nothing where the position is NaN; a change costs
    `CHANGE_M`.
    """
    known = np.isfinite(positions_m).all(axis=1)
    cost = np.zeros((len(positions_m), len(sides)))
    for i, side in enumerate(sides):
        path = TruthPath(side.points_m, closed=False, std_m=0.0)
        cost[known, i] = distance_to_path(positions_m[known], path)
    change = CHANGE_M * (1.0 - np.eye(len(sides)))
    total = np.zeros(len(sides))
    came_from = np.zeros(cost.shape, dtype=np.int64)
    for i, here in enumerate(cost):
        ways = total[:, None] + change
        # On a corner the side that begins there has the frame, as a limit ends before its time.
        stays = ways.diagonal() <= ways.min(axis=0) + _TIE_M
        came_from[i] = np.where(stays, np.arange(len(sides)), ways.argmin(axis=0))
        total = ways.min(axis=0) + here
    chosen = np.zeros(len(cost), dtype=np.int64)
    best = int(total.argmin())
    for i in range(len(cost) - 1, -1, -1):
        chosen[i] = best
        best = int(came_from[i, best])
    return chosen


def _turn_deg(before: tuple[Array, Array], after: tuple[Array, Array]) -> float:
    a, b = before[1] - before[0], after[1] - after[0]
    cross = a[0] * b[1] - a[1] * b[0]
    return abs(float(np.degrees(np.arctan2(cross, a @ b))))
