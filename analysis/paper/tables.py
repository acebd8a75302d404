"""The paper's tables, whole, beside ours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from analysis.paper.configuration_one import CountErrors, Stand, of_class
from analysis.paper.experiments import Experiments
from analysis.paper.references import CLASSES, COUNT, PLACEMENT_HIGH, PLACEMENT_LOW, Row
from analysis.paper.site import Site
from analysis.paper.tracking_tables import tracking_tables
from analysis.study import StudyTable
from pipeline.geometry import Array
from pipeline.variance import PAPER_TABLE

# x and y in cm, heading in degrees.
_SCALE = np.array([100.0, 100.0, 180.0 / np.pi])
_AXES = ("x cm", "y cm", "θ °")
_OURS = (
    "Ours: the RMSE over all seeds; of the mean error its typical size, the root mean square over "
    "the seeds, since each seed's errors of installation and calibration give it another sign."
)


def all_tables(runs: Experiments) -> list[StudyTable]:
    """In the order of the paper: variances, both heights, number of markers, then tracking."""
    return [
        variances(runs),
        placement(
            runs.sites["configuration_1_low"], runs.low, PLACEMENT_LOW, "low", "1.334 m (Table II)"
        ),
        placement(
            runs.sites["configuration_1_high"],
            runs.high,
            PLACEMENT_HIGH,
            "high",
            "2.991 m (Table III)",
        ),
        count(runs),
        count_batch(runs),
        *tracking_tables(runs),
    ]


def variances(runs: Experiments) -> StudyTable:
    """Table I."""
    rows = [
        {
            "markers": n,
            "paper σ²x cm²": paper[0],
            "ours σ²x cm²": ours[0],
            "paper σ²y cm²": paper[1],
            "ours σ²y cm²": ours[1],
        }
        for n, (paper, ours) in enumerate(zip(PAPER_TABLE.cm2, runs.fitted.cm2, strict=True), 1)
    ]
    return StudyTable(
        "variances",
        "Variances by number of markers (Table I)",
        pd.DataFrame(rows),
        (
            "Ours: of the batch solver, about each seed's mean over all subsets, averaged over the "
            "seeds.",
        ),
    )


def placement(
    site: Site, stands: Sequence[Stand], paper: dict[str, Row], name: str, where: str
) -> StudyTable:
    """Tables II and III: single markers by class."""
    rows = []
    for label in CLASSES:
        by_seed = [of_class(site, stand, label) * _SCALE for stand in stands]
        rows.append({"markers": label, **_beside(paper[label], by_seed)})
    n = len(of_class(site, stands[0], "all"))
    return StudyTable(
        f"placement_{name}",
        f"Single markers at {where}",
        pd.DataFrame(rows),
        (f"{n} markers in {len(stands)} seeds.", _OURS),
    )


def count(runs: Experiments) -> StudyTable:
    """Table IV, with the largest error, of which the paper shows only a figure."""
    rows = []
    for n, paper in COUNT.items():
        counts = [stand.counts[n] for stand in runs.high]
        rmse, mean, largest = _pooled(counts)
        known = counts[0].subsets == counts[0].of
        row: dict[str, float] = {"markers": n, **_columns(paper, rmse, mean)}
        rows.append(row | {"ours max cm": largest if known else np.nan})
    sampled = ", ".join(
        f"{c.subsets} of {c.of} with {n}"
        for n, c in runs.high[0].counts.items()
        if c.subsets < c.of
    )
    return StudyTable(
        "count",
        "By number of markers at 2.991 m, the paper's solver (Table IV)",
        pd.DataFrame(rows),
        (
            f"Every subset up to five markers; random ones above: {sampled}.",
            _OURS,
            "Max: the largest position error, median over the seeds; a sample has none.",
        ),
    )


def count_batch(runs: Experiments) -> StudyTable:
    """Every subset by the batch solver, beside the paper's solver."""
    rows = []
    for n in COUNT:
        plain_rmse, _, plain_largest = _pooled([s.counts[n] for s in runs.high])
        rmse, mean, largest = _pooled([s.batch[n] for s in runs.high])
        rows.append(
            {
                "markers": n,
                "subsets": runs.high[0].batch[n].subsets,
                **{f"RMSE {axis}": float(v) for axis, v in zip(_AXES, rmse, strict=True)},
                **{f"mean {axis}": float(v) for axis, v in zip(_AXES, mean, strict=True)},
                "max cm": largest,
                "paper's solver RMSE x cm": float(plain_rmse[0]),
                "paper's solver RMSE y cm": float(plain_rmse[1]),
                "paper's solver max cm": plain_largest
                if runs.high[0].counts[n].subsets == runs.high[0].counts[n].of
                else np.nan,
            }
        )
    return StudyTable(
        "count_batch",
        "By number of markers at 2.991 m, the batch solver, every subset",
        pd.DataFrame(rows),
        ("The same images, the same cost function, another start and no RANSAC.",),
    )


def _pooled(counts: Sequence[CountErrors]) -> tuple[Array, Array, float]:
    """RMSE and typical mean error (3,) in cm, cm, degrees; median of the largest error in cm."""
    rmse = np.sqrt(np.mean([c.rmse**2 for c in counts], axis=0)) * _SCALE
    mean = np.sqrt(np.mean([c.mean**2 for c in counts], axis=0)) * _SCALE
    return rmse, mean, 100.0 * float(np.median([c.max_m for c in counts]))


def _beside(paper: Row, by_seed: Sequence[Array]) -> dict[str, float]:
    everything = np.concatenate(by_seed)
    rmse = np.sqrt((everything**2).mean(axis=0))
    mean = np.sqrt(np.mean([errors.mean(axis=0) ** 2 for errors in by_seed], axis=0))
    return _columns(paper, rmse, mean)


def _columns(paper: Row, rmse: Array, mean: Array) -> dict[str, float]:
    row: dict[str, float] = {}
    for i, axis in enumerate(_AXES):
        row[f"paper RMSE {axis}"], row[f"ours RMSE {axis}"] = paper[i], float(rmse[i])
    for i, axis in enumerate(_AXES):
        row[f"paper mean {axis}"], row[f"ours mean {axis}"] = paper[3 + i], float(mean[i])
    return row
