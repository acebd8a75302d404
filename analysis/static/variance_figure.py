"""The measured variances beside the paper's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.static.variance_measure import MeasuredVariance
from analysis.study import StudyFigure
from analysis.style import PALETTE, TRUTH_COLOUR, WIDE, new_figure
from pipeline.variance import PAPER_TABLE


def variance_figure(rows: Sequence[MeasuredVariance]) -> StudyFigure:
    """σ² in x and y by number of markers with its interval, the robust one, the paper's."""
    figure = new_figure((WIDE[0], 4.2))
    panels = figure.subplots(1, 2, sharey=True)
    markers = [row.markers for row in rows]
    paper = np.array(PAPER_TABLE.cm2)
    for i, (axes, axis) in enumerate(zip(panels, ("x", "y"), strict=True)):
        cm2 = np.array([row.cm2[i] for row in rows])
        low = np.array([row.low_cm2[i] for row in rows])
        high = np.array([row.high_cm2[i] for row in rows])
        axes.errorbar(
            markers,
            cm2,
            np.array([cm2 - low, high - cm2]),
            fmt="o-",
            color=PALETTE[0],
            capsize=4,
            label="measured, 95 %",
        )
        robust = [row.robust_cm2[i] for row in rows]
        axes.plot(markers, robust, "s--", color=PALETTE[1], label="robust")
        axes.plot(
            range(1, len(paper) + 1), paper[:, i], "D:", color=TRUTH_COLOUR, label="the paper's"
        )
        axes.set(title=f"σ²{axis}", xlabel="markers", yscale="log")
        axes.set_xticks(range(1, max(*markers, len(paper)) + 1))
        axes.yaxis.set_major_formatter("{x:g}")
    panels[0].set_ylabel("cm²")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return StudyFigure(
        "variance",
        "Variance of a position fix by number of markers",
        figure,
        "The paper's table is of its own site, at 2.991 m.",
    )
