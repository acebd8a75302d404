"""One finding of the paper as a question that each seed answers with yes or no."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.static.statistics import wilson
from pipeline.geometry import Array


@dataclass(frozen=True)
class Finding:
    """One finding of the paper, and how it fares here.

    Attributes:
        question: what is asked of each seed, in words precise enough to disagree with.
        holds: the answer of each seed.
        picture: name of the figure that shows it.
        here: the numbers behind it, in one sentence.
        because: why it holds or does not, where that is known.
    """

    title: str
    question: str
    holds: tuple[bool, ...]
    picture: str
    here: str
    because: str = ""

    @property
    def share(self) -> float:
        return float(np.mean(self.holds))

    @property
    def verdict(self) -> str:
        """In a word; a finding that hangs on the installation's luck is neither."""
        if self.share >= 0.8:
            return "holds"
        return "does not hold" if self.share <= 0.2 else "depends on the seed"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of the share (Wilson): what other seeds could have given."""
        return wilson(sum(self.holds), len(self.holds))


def centimetres(values_m: Array | list[float]) -> str:
    """The median, in cm."""
    return f"{100 * float(np.median(values_m)):.2f} cm"
