"""Every figure, by its name."""

from __future__ import annotations

from analysis.paper.experiments import Experiments
from analysis.paper.pictures import counts, placement, tracking
from analysis.study import StudyFigure


def all_pictures(runs: Experiments) -> dict[str, StudyFigure]:
    """Placement, numbers of markers, filters."""
    pictures = (
        placement.scatter(runs),
        placement.rings(runs),
        placement.classes(runs),
        placement.pairs(runs),
        counts.errors(runs),
        counts.axes(runs),
        tracking.sides(runs),
        tracking.trajectory(runs),
        tracking.trajectory_top(runs),
        tracking.speeds(runs),
        tracking.consistency(runs),
    )
    return {picture.name: picture for picture in pictures}
