"""All runs that the page is made of."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import TypeVar

import numpy as np

from analysis.paper.configuration_one import (
    MAX_COUNT,
    Stand,
    by_batch,
    stand_alone,
    stand_by_opencv,
)
from analysis.paper.configuration_two import Outcome, outcome
from analysis.paper.site import Site, open_site
from pipeline.localizer import PAPER_TRACKERS
from pipeline.tracker import ConstantVelocity
from pipeline.variance import PAPER_TABLE, StaticVariance, TableVariance, VarianceTable

T = TypeVar("T")

SPEEDS_MPS = (0.05, 0.2, 0.5)
FITTED = "fitted-"
# As the paper's filter, but for the table: which of the two changes matters.
QUARTER = "fitted-adaptive-quarter"


@dataclass(frozen=True, eq=False)
class Experiments:
    """Every seed's outcome, and the table of variances that configuration I gave.

    Attributes:
        low, high: configuration I, one per seed.
        drives: configuration II, one per seed, by speed.
        fitted: mean variances over the seeds, for the trackers named `fitted-…`.
    """

    sites: dict[str, Site]
    low: list[Stand]
    high: list[Stand]
    drives: dict[float, list[Outcome]]
    fitted: VarianceTable


def run(seeds: int, tick: Callable[[], None] = lambda: None) -> Experiments:
    """Runs both configurations for so many seeds; `tick` is called `ticks(seeds)` times."""
    names = ("configuration_1_low", "configuration_1_high", "configuration_2")
    sites = {}
    for name in names:
        sites[name] = open_site(name)
        tick()
    low_site, high_site = sites["configuration_1_low"], sites["configuration_1_high"]
    # Processes of their own: OpenCV's loop holds the interpreter most of the time.
    with _workers() as pool:
        low = list(_done([pool.submit(stand_alone, low_site, s) for s in range(seeds)], tick))
        plain = [pool.submit(stand_by_opencv, high_site, s) for s in range(seeds)]
        high = list(_done(plain, tick))
    high = [replace(s, batch=by_batch(high_site, i, tick)) for i, s in enumerate(high)]
    fitted = fitted_table(high)
    drives: dict[float, list[Outcome]] = {}
    with _workers() as pool:
        for speed in SPEEDS_MPS:
            driven = [
                pool.submit(outcome, sites["configuration_2"], seed, speed, trackers(fitted))
                for seed in range(seeds)
            ]
            drives[speed] = list(_done(driven, tick))
    return Experiments(sites, low, high, drives, fitted)


def _workers() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        os.cpu_count(), mp_context=get_context("spawn"), initializer=_end_with_parent
    )


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os._exit(1)

    Thread(target=wait, daemon=True).start()


def _done(futures: list[Future[T]], tick: Callable[[], None]) -> Iterator[T]:
    for future in futures:
        yield future.result()
        tick()


def ticks(seeds: int) -> int:
    """How often `run` calls back."""
    return 3 + seeds * (1 + 1 + MAX_COUNT + len(SPEEDS_MPS))


def fitted_table(stands: list[Stand]) -> VarianceTable:
    """σ²x, σ²y about the mean over all subsets, by number of markers; the mean over the seeds."""
    rows = []
    for count in range(1, MAX_COUNT + 1):
        # The batch has every subset, and none of RANSAC's failures, which no table should hold.
        variances = [s.batch[count].variance_m2 for s in stands]
        x_m2, y_m2 = np.mean(variances, axis=0)
        rows.append((float(x_m2) * 1e4, float(y_m2) * 1e4))
    return VarianceTable(cm2=tuple(rows))


def trackers(fitted: VarianceTable) -> dict[str, ConstantVelocity]:
    """The paper's five filters; the same five with our table, and R as it was measured.

    And the adaptive one with our table and the paper's R = σ²/4.
    """
    ours = {
        name: settings.model_copy(update={"variance": _with_table(settings, fitted)})
        for name, settings in PAPER_TRACKERS.items()
    }
    honest = {name: settings.model_copy(update={"r_scale": 1.0}) for name, settings in ours.items()}
    return (
        PAPER_TRACKERS
        | {FITTED + name: settings for name, settings in honest.items()}
        | {QUARTER: ours["adaptive"]}
    )


def _with_table(settings: ConstantVelocity, table: VarianceTable) -> TableVariance | StaticVariance:
    variance = settings.variance
    if isinstance(variance, StaticVariance):
        return StaticVariance(statistic=variance.statistic, table=table)
    if not isinstance(variance, TableVariance) or variance.table != PAPER_TABLE:
        raise ValueError(f"expected one of the paper's models, found {variance.kind}")
    return TableVariance(table=table)
