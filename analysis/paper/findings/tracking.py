"""What the five filters make of the drive, by the tracking study's own figures."""

from __future__ import annotations

import numpy as np

from analysis.paper.configuration_two import (
    BOTTOM,
    LEFT,
    PAPER_FILTERS,
    RIGHT,
    TOP,
    Outcome,
)
from analysis.paper.experiments import SPEEDS_MPS, Experiments
from analysis.paper.findings.finding import Finding


def tracking_findings(runs: Experiments) -> list[Finding]:
    """Of the slowest drive, at which the paper's process noise is honest."""
    drives = runs.drives[SPEEDS_MPS[0]]
    few = [min(_to_adaptive(d, "accel_rms_cmps2", s) for s in (TOP, LEFT)) for d in drives]
    many = [max(_to_adaptive(d, "path_rms_cm", s) for s in (BOTTOM, RIGHT)) for d in drives]
    late_cm = {
        name: [
            float(np.mean([d.value("path_rms_cm", name, s) for s in (LEFT, BOTTOM, RIGHT)]))
            for d in drives
        ]
        for name in PAPER_FILTERS
    }
    rmse_cm = {name: [d.value("rmse_position_cm", name) for d in drives] for name in PAPER_FILTERS}
    best = {speed: [_is_best(d) for d in outcomes] for speed, outcomes in runs.drives.items()}
    return [
        Finding(
            "`min` is good with five or more markers",
            "on the sides with five and all markers its distance to the path is within 10 % of "
            "the adaptive model's",
            tuple(bool(m < 1.1) for m in many),
            "sides",
            f"on average {np.mean(many):.2f} times the adaptive model's.",
        ),
        Finding(
            "`min` is jagged with three or fewer",
            "on the sides with one and three markers its RMS acceleration is at least 1.5 times "
            "the adaptive model's",
            tuple(bool(f >= 1.5) for f in few),
            "trajectory_top",
            f"on average {np.mean(few):.1f} times on the smoother of the two sides.",
        ),
        Finding(
            "`max`, `mean` and `median` deviate",
            "on the sides with three or more markers each is further from the path than the "
            "adaptive model",
            tuple(
                all(late_cm[name][i] > late_cm["adaptive"][i] for name in ("max", "mean", "median"))
                for i in range(len(drives))
            ),
            "trajectory",
            "distance to the path on these sides, median over the seeds: "
            + ", ".join(f"{n} {np.median(cm):.2f} cm" for n, cm in late_cm.items())
            + ".",
        ),
        Finding(
            "Adaptive is best over the whole path",
            "its position RMSE over the whole drive is the smallest of the five at 0.05 m/s",
            tuple(best[SPEEDS_MPS[0]]),
            "speeds",
            "median RMSE "
            + ", ".join(f"{n} {np.median(cm):.2f} cm" for n, cm in rmse_cm.items())
            + "; best in "
            + ", ".join(f"{np.mean(b):.0%} of the seeds at {v:g} m/s" for v, b in best.items())
            + ".",
            "With 1 cm/s² of process noise and no initial variance of the velocity every filter "
            "with large variances lags behind a faster robot: adaptive on the single-marker side "
            "too, where `min` then wins because it follows the fixes.",
        ),
    ]


def _to_adaptive(outcome: Outcome, column: str, side: str) -> float:
    """`min`'s value over the adaptive model's."""
    return outcome.value(column, "min", side) / outcome.value(column, "adaptive", side)


def _is_best(outcome: Outcome) -> bool:
    rmse_cm = {name: outcome.value("rmse_position_cm", name) for name in PAPER_FILTERS}
    return min(rmse_cm, key=lambda name: rmse_cm[name]) == "adaptive"
