"""Each seed as a faint mark beside their middle, as several figures show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from analysis.style import PALETTE, TRUTH_COLOUR
from pipeline.geometry import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH = 0.5


def strip(axes: Axes, labels: Sequence[str], values: Sequence[Sequence[float]]) -> None:
    """For each label its seeds' values side by side, and a line at their median."""
    for at, seeds in enumerate(values):
        beside = at + _WIDTH * (np.linspace(0.0, 1.0, len(seeds)) - 0.5)
        axes.plot(beside, seeds, ".", color=PALETTE[0], alpha=0.45, markersize=5)
        middle = float(np.median(seeds))
        axes.plot(
            [at - _WIDTH / 2, at + _WIDTH / 2],
            [middle, middle],
            color=PALETTE[0],
            linewidth=2.5,
            label="here: a mark for each seed, the median as a line" if at == 0 else None,
        )
    axes.set_xticks(range(len(labels)), labels)


def paper_marks(axes: Axes, values: Sequence[float | None]) -> None:
    """The paper's value at each label that it has one for."""
    known = [(at, value) for at, value in enumerate(values) if value is not None]
    axes.plot(*zip(*known, strict=True), "D", color=TRUTH_COLOUR, markersize=6, label="paper")


def curves(axes: Axes, x: Sequence[int], values: Array, mark: str, colour: str, name: str) -> None:
    """A thin line for each seed of `values` (seeds, len(x)), the median thick."""
    axes.plot(x, values.T, color=colour, alpha=0.2, linewidth=0.7)
    middle = np.median(values, axis=0)
    axes.plot(x, middle, f"{mark}-", color=colour, linewidth=2.0, markersize=5, label=name)
