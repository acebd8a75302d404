"""What the placement study says in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from analysis.static.alone import Alone
from analysis.static.statistics import statistics
from pipeline.geometry import Array

if TYPE_CHECKING:
    import pandas as pd


def _horizontal_rmse_cm(errors: Array) -> float:
    """RMSE of the horizontal position of (…, 3) errors in cm."""
    x, y = statistics(errors[..., 0])["rmse"], statistics(errors[..., 1])["rmse"]
    return float(np.hypot(x, y))


def height_findings(views: Sequence[Alone]) -> list[str]:
    # A second look from the same height says nothing of distance.
    if len(views) < 2 or views[-1].height_m < 1.05 * views[0].height_m:
        return []
    near, far = (_horizontal_rmse_cm(view.errors) for view in (views[0], views[-1]))
    if not near > 0:
        return []
    verdict = "more distance is worse" if far > near else "more distance is not worse here"
    return [
        f"Distance: horizontal RMSE of one marker {near:.2f} cm at {views[0].label}, {far:.2f} cm "
        f"at {views[-1].label} ({far / near:.1f} times): {verdict}."
    ]


def class_findings(views: Sequence[Alone]) -> list[str]:
    found = []
    for view in views:
        names = list(dict.fromkeys(view.grouping.class_of.values()))
        classes = {g.name: g.ids for g in view.grouping.rows if g.name in names}
        if len(classes) > 1:
            rmse = {name: _horizontal_rmse_cm(view.of(ids)) for name, ids in classes.items()}
            order = sorted(rmse, key=lambda name: rmse[name])
            listed = ", ".join(f"{name} {rmse[name]:.2f} cm" for name in order)
            found.append(
                f"Rotation at {view.label}: horizontal RMSE by class, best first: {listed}."
            )
    return found


def ring_findings(share: pd.DataFrame, views: Sequence[Alone], large_cm: float) -> list[str]:
    found = []
    for view in views:
        rows = share[share["height_m"] == view.height]
        listed = ", ".join(
            f"{row.ring} {row.markers_above_pct:.1f} % of the markers and "
            f"{row.fixes_above_pct:.1f} % of the fixes"
            for row in rows.itertuples()
        )
        found.append(f"Errors above {large_cm:g} cm at {view.label}: {listed}.")
    return found
