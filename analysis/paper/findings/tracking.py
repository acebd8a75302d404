"""What the five filters make of the drive, by the tracking study's own figures."""

from __future__ import annotations

from collections import Counter

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

# Closer than this to the adaptive model is as good as it.
MARGIN = 1.1


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
    best = {speed: [_nearest(d) for d in outcomes] for speed, outcomes in runs.drives.items()}
    deviates = {
        name: [far >= MARGIN * near for far, near in zip(cm, late_cm["adaptive"], strict=True)]
        for name, cm in late_cm.items()
    }
    in_band = {
        name: float(np.mean([d.value("in_band_percent", name) for d in drives]))
        for name in PAPER_FILTERS
    }
    return [
        Finding(
            "`min` is good with five or more markers",
            "on the sides with five and all markers its distance to the path is within 10 % of "
            "the adaptive model's",
            tuple(bool(m < MARGIN) for m in many),
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
        *(
            Finding(
                title,
                "on the sides with three or more markers "
                + ("both are" if len(names) > 1 else "it is")
                + " at least 10 % further from the path than the adaptive model",
                tuple(all(deviates[name][i] for name in names) for i in range(len(drives))),
                "trajectory",
                "distance to the path on these sides, median over the seeds: "
                + ", ".join(f"{n} {np.median(cm):.2f} cm" for n, cm in late_cm.items())
                + ".",
                "The side with one marker is left out: there `max` is the adaptive model.",
            )
            for title, names in (
                ("`max` and `mean` deviate", ("max", "mean")),
                ("`median` deviates", ("median",)),
            )
        ),
        Finding(
            "Adaptive is best over the whole path",
            "its position RMSE over the whole drive is the smallest of the five at 0.05 m/s",
            tuple(name == "adaptive" for name in best[SPEEDS_MPS[0]]),
            "speeds",
            "median RMSE "
            + ", ".join(f"{n} {np.median(cm):.2f} cm" for n, cm in rmse_cm.items())
            + ". By the share within ±5 cm the order is another: "
            + ", ".join(
                f"{n} {in_band[n]:.0f} %" for n in sorted(in_band, key=lambda n: -in_band[n])
            )
            + ". Nearest at other speeds: "
            + "; ".join(f"{v:g} m/s: {_counted(best[v])}" for v in SPEEDS_MPS[1:])
            + ".",
            "With 1 cm/s² of process noise and no initial variance of the velocity every filter "
            "with large variances lags behind a faster robot, the adaptive one on the side with "
            "one marker too.",
        ),
    ]


def _to_adaptive(outcome: Outcome, column: str, side: str) -> float:
    """`min`'s value over the adaptive model's."""
    return outcome.value(column, "min", side) / outcome.value(column, "adaptive", side)


def _nearest(outcome: Outcome) -> str:
    """Which of the five has the smallest RMSE over the whole drive."""
    rmse_cm = {name: outcome.value("rmse_position_cm", name) for name in PAPER_FILTERS}
    return min(rmse_cm, key=lambda name: rmse_cm[name])


def _counted(names: list[str]) -> str:
    counts = Counter(names).most_common()
    return ", ".join(f"{name} in {count} of {len(names)} seeds" for name, count in counts)
