"""Pairs of markers: the error against their separation and their distance from the centre."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats
from tqdm import tqdm

from analysis.static.alone import solve_each
from analysis.static.view import StillView
from analysis.study import StudyTable
from pipeline.geometry import Array

# Frames of a long log, spread evenly: pairs are many, and the camera stands still.
MAX_FRAMES = 20

# A pattern in fewer pairs is none.
MIN_PAIRS = 10


@dataclass(frozen=True, eq=False)
class Pairs:
    """Each pair of markers that was solved.

    Attributes:
        separation_m: (N,) distance between the two markers' centres in the map.
        centre_px: (N,) mean distance of the two from the image centre.
        rms_cm: (N,) root mean square of the horizontal position error over the frames.
    """

    ids: tuple[tuple[int, ...], ...]
    separation_m: Array
    centre_px: Array
    rms_cm: Array
    frames: int


def solve_pairs(view: StillView, *, progress: bool = False) -> Pairs | None:
    """All pairs, solved in at most `MAX_FRAMES` frames; None with fewer than `MIN_PAIRS`."""
    count = min(MAX_FRAMES, len(view.frames))
    at = np.unique(np.linspace(0, len(view.frames) - 1, count).round().astype(int))
    with tqdm(
        total=count,
        unit="frame",
        desc="pairs",
        file=sys.stderr,
        disable=None if progress else True,
    ) as bar:
        fixes = solve_each(view, 2, [view.frames[i] for i in at], step=bar.update)
    cm = 100.0 * fixes.horizontal_m
    known = np.isfinite(cm)
    solved = np.flatnonzero(known.any(axis=0))
    if len(solved) < MIN_PAIRS:
        return None
    ids = tuple(fixes.subsets[i] for i in solved)
    centres = {i: view.marker_map.by_id[i].centre_m for i in view.ids}
    far = view.centre_distance_px
    return Pairs(
        ids,
        np.array([np.linalg.norm(centres[a] - centres[b]) for a, b in ids]),
        np.array([(far[a] + far[b]) / 2.0 for a, b in ids]),
        np.sqrt(np.nansum(cm[:, solved] ** 2, axis=0) / known[:, solved].sum(axis=0)),
        len(at),
    )


def table(views: Sequence[tuple[str, Pairs]]) -> StudyTable:
    """Errors by thirds of separation and of distance from the image centre."""
    import pandas as pd

    rows, empty = [], []
    for height, found in views:
        near, apart = thirds(found.separation_m), thirds(found.centre_px)
        for s in range(3):
            for c in range(3):
                inside = (near.part == s) & (apart.part == c)
                cm = found.rms_cm[inside]
                if not len(cm):
                    empty.append(
                        f"{near.names(2)[s]} m apart, {apart.names(0)[c]} px from the centre, "
                        f"height {height}"
                    )
                rows.append(
                    {
                        "height_m": height,
                        "separation_m": near.names(2)[s],
                        "centre_distance_px": apart.names(0)[c],
                        "pairs": len(cm),
                        "rmse_cm": float(np.sqrt(np.mean(cm**2))) if len(cm) else np.nan,
                        "median_cm": float(np.median(cm)) if len(cm) else np.nan,
                        "max_cm": float(cm.max()) if len(cm) else np.nan,
                    }
                )
    return StudyTable(
        "placement_pairs",
        "Two markers: horizontal position error by their separation and distance from the centre",
        pd.DataFrame(rows),
        (
            "Rows are thirds of the pairs by separation, in each thirds by mean distance from the "
            "image centre; a pair's error is the root mean square over frames "
            f"({'; '.join(f'{found.frames} at {height}' for height, found in views)}).",
            *([f"No pairs, so cells are empty: {'; '.join(empty)}."] if empty else []),
        ),
    )


@dataclass(frozen=True, eq=False)
class Thirds:
    """`part`: (N,) 0, 1, 2 for each value; `edges`: (4,)."""

    part: npt.NDArray[np.int64]
    edges: Array

    def names(self, digits: int) -> list[str]:
        e = [f"{edge:.{digits}f}" for edge in self.edges]
        return [f"{e[0]} to {e[1]}", f"{e[1]} to {e[2]}", f"{e[2]} to {e[3]}"]


def thirds(values: Array) -> Thirds:
    """The values in three parts at their own thirds; ties stay together."""
    edges = np.quantile(values, (0.0, 1 / 3, 2 / 3, 1.0))
    return Thirds(np.searchsorted(edges[1:3], values, side="left").astype(np.int64), edges)


def findings(label: str, found: Pairs) -> list[str]:
    """Rank correlations, and the best and the worst third of each."""
    parts = []
    for name, values in (
        ("separation", found.separation_m),
        ("distance from the centre", found.centre_px),
    ):
        if np.ptp(values) == 0 or np.ptp(found.rms_cm) == 0:
            continue
        rank = float(stats.spearmanr(values, found.rms_cm).statistic)
        third = thirds(values)
        low, high = (np.median(found.rms_cm[third.part == p]) for p in (0, 2))
        parts.append(
            f"{name}: rank correlation with the error {rank:+.2f}, median {low:.2f} cm in the "
            f"smallest third, {high:.2f} cm in the largest"
        )
    return [f"Pairs at {label}: {'; '.join(parts)}."] if parts else []
