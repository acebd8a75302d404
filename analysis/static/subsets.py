"""Fixes from many subsets of the markers in view: every one, or a random sample of them."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from analysis.static.store import Store
from analysis.static.view import StillFrame, StillView
from pipeline.geometry import Array, wrap_angle
from recorder.errors import InputError

IntArray = npt.NDArray[np.int64]
SolverName = Literal["batch", "opencv"]

# Of one number of markers all subsets and fixes are held at once, with what statistics make of
# them: more subsets than fit in this are sampled. The whole process stays below 1 GB.
MAX_BYTES = 600_000_000

# Fixes, errors, and copies of them.
_BYTES_PER_FIX = 120
# Of each marker of a subset: its position, and as much again while they are drawn.
_BYTES_PER_MEMBER = 16

# Ranks of subsets are int64.
_MAX_SUBSETS = 2**63 - 1

# Subsets solved in one go, and kept together.
PIECE = 65_536


@dataclass(frozen=True)
class SubsetOptions:
    """Which subsets to solve.

    Attributes:
        sample: at most so many subsets of each size, drawn at random; None: every one.
        n_frames: the first frames with the most markers; None: all.
        keep: folder for what is solved, so that a second run goes on; None: nothing is kept.
    """

    max_markers: int = 7
    solver: SolverName = "batch"
    sample: int | None = None
    n_frames: int | None = 1
    seed: int = 0
    keep: Path | None = None
    progress: bool = True


@dataclass(frozen=True, eq=False)
class Layouts:
    """Subsets of one size: (M, size) positions in `ids`, ascending; `of` is how many there are."""

    ids: tuple[int, ...]
    members: IntArray
    of: int

    @property
    def size(self) -> int:
        return int(self.members.shape[1])

    @property
    def sampled(self) -> bool:
        return len(self.members) < self.of

    def named(self, number: int) -> str:
        """The marker ids of one subset, as tables show them."""
        return " ".join(str(self.ids[i]) for i in self.members[number])


@dataclass(frozen=True, eq=False)
class SubsetFixes:
    """Fixes of all subsets of one size, in every frame.

    Attributes:
        values: (frames, M, 3) x m, y m, yaw rad; NaN without a finite pose.
        converged: (frames, M) as the solver says; a finite pose counts in any case.
    """

    layouts: Layouts
    values: Array
    converged: npt.NDArray[np.bool_]


def differences(values: Array, reference: Array) -> Array:
    """x, y and wrapped yaw of values (…, 3) less a reference."""
    difference = values - reference
    difference[..., 2] = wrap_angle(difference[..., 2])
    return difference


@dataclass(frozen=True, eq=False)
class Selection:
    """The frames and markers of a view that are studied: the same markers in every frame."""

    frames: tuple[StillFrame, ...]
    ids: tuple[int, ...]

    @property
    def truth(self) -> Array:
        return np.array([frame.truth for frame in self.frames])

    def note(self, view: StillView) -> str:
        left = [i for i in view.ids if i not in self.ids]
        indices = ", ".join(str(frame.frame_index) for frame in self.frames[:5])
        more = ", …" if len(self.frames) > 5 else ""
        note = (
            f"{len(self.frames)} of {len(view.frames)} frames (index {indices}{more}), "
            f"{len(self.ids)} markers"
        )
        if left:
            note += f"; not in all of these frames and left out: {', '.join(map(str, left))}"
        return note + "."


def select_frames(view: StillView, n_frames: int | None, *, for_errors: bool = False) -> Selection:
    """The first `n_frames` frames (None: all) with the most markers, and the markers in all.

    Args:
        for_errors: only frames whose true position is known, where there are such.

    Raises:
        InputError: no marker is in all of them.
    """
    pool = [frame for frame in view.frames if for_errors and frame.has_truth] or view.frames
    order = sorted(range(len(pool)), key=lambda f: (-len(pool[f].detections), f))
    frames = tuple(pool[f] for f in sorted(order[:n_frames]))
    ids = view.common_ids(frames)
    if not ids:
        raise InputError(
            view.result.folder,
            f"expected a marker that is seen in all of {len(frames)} frames, found none; "
            "ask for fewer with --frames",
        )
    return Selection(frames, ids)


def layouts(ids: Sequence[int], size: int, limit: int, seed: int) -> Layouts:
    """Every subset of `size` of the markers, or `limit` different ones drawn at random."""
    from pipeline.batch_pose import sample_subsets

    members = sample_subsets(len(ids), size, limit, seed)
    return Layouts(tuple(ids), members, math.comb(len(ids), size))


def solve_sizes(
    view: StillView, chosen: Selection, sizes: Sequence[int], options: SubsetOptions
) -> Iterator[SubsetFixes]:
    """The fixes of each size in turn; memory is that of the largest, if they are not kept.

    Raises:
        InputError: there are too many subsets of a size even to draw some.
    """
    store = Store(options.keep, view, options.solver)
    n, counts = len(chosen.ids), []
    for size in sizes:
        of = math.comb(n, size)
        if of > _MAX_SUBSETS:
            raise InputError(
                view.result.folder,
                f"expected fewer than 2**63 subsets, found those of {size} of the {n} markers "
                "in view; ask for smaller ones with --max",
            )
        room = MAX_BYTES // (_BYTES_PER_FIX * len(chosen.frames) + _BYTES_PER_MEMBER * size)
        counts.append(min(of, max(1, room), options.sample or of))
    total = sum(counts) * len(chosen.frames)
    with tqdm(
        total=total,
        unit="pose",
        unit_scale=True,
        desc="solve",
        file=sys.stderr,
        disable=None if options.progress else True,
    ) as bar:
        for size, count in zip(sizes, counts, strict=True):
            each = layouts(chosen.ids, size, count, options.seed)
            yield _solve(chosen, each, store, bar.update)


def _solve(
    chosen: Selection, each: Layouts, store: Store, solved: Callable[[int], object]
) -> SubsetFixes:
    shape = (len(chosen.frames), len(each.members))
    values = np.full((*shape, 3), np.nan)
    converged = np.zeros(shape, dtype=bool)
    for f, frame in enumerate(chosen.frames):
        seen = frame.detections.select(np.isin(frame.detections.ids, chosen.ids))
        for start in range(0, shape[1], PIECE):
            span = slice(start, min(start + PIECE, shape[1]))
            piece = store.solve(seen, each.members[span], solved)
            finite = np.isfinite(piece.positions_m[:, :2]).all(axis=1)
            finite &= np.isfinite(piece.yaw_rad)
            values[f, span, :2] = np.where(finite[:, None], piece.positions_m[:, :2], np.nan)
            values[f, span, 2] = np.where(finite, piece.yaw_rad, np.nan)
            converged[f, span] = piece.converged & finite
    return SubsetFixes(each, values, converged)
