"""How much a position fix is trusted: the measurement variances of the tracker."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, Protocol

import numpy as np
from pydantic import Field, PositiveFloat, field_validator

from pipeline.pose import PoseFix
from pipeline.settings import Settings


class Variance(NamedTuple):
    """Variance of a fix per axis, m²."""

    x_m2: float
    y_m2: float


class VarianceModel(Protocol):
    """Measurement variance of one position fix, per axis, before the tracker's `r_scale`."""

    def __call__(self, fix: PoseFix) -> Variance: ...


class VarianceTable(Settings):
    """Measured variances by number of markers: one, two, …; the last row is for all above.

    Attributes:
        cm2: rows of σ²x, σ²y in cm².
    """

    cm2: tuple[tuple[PositiveFloat, PositiveFloat], ...]

    @field_validator("cm2")
    @classmethod
    def _not_empty(cls, rows: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if not rows:
            raise ValueError("expected at least one row of variances, found none")
        return rows

    def row(self, n_markers: int) -> Variance:
        """The row for `n_markers` >= 1, clamped to the last.

        Raises:
            ValueError: fewer than one marker.
        """
        if n_markers < 1:
            raise ValueError(f"expected at least one marker, found {n_markers}")
        x_cm2, y_cm2 = self.cm2[min(n_markers, len(self.cm2)) - 1]
        return Variance(x_cm2 * 1e-4, y_cm2 * 1e-4)

    def reduce(self, statistic: Statistic) -> Variance:
        """One statistic over all rows, per axis."""
        x_cm2, y_cm2 = getattr(np, statistic)(np.array(self.cm2), axis=0)
        return Variance(float(x_cm2) * 1e-4, float(y_cm2) * 1e-4)


Statistic = Literal["min", "max", "mean", "median"]

# Source: Hinderer, Scheffler, Yang, ICAR 2025, Table I.
PAPER_TABLE = VarianceTable(
    cm2=(
        (1944.56, 914.43),
        (603.46, 464.10),
        (68.88, 64.47),
        (19.35, 16.77),
        (7.62, 6.64),
        (4.46, 3.49),
        (3.04, 2.09),
    )
)


class TableVariance(Settings):
    """By the number of markers used: the paper's adaptive model."""

    kind: Literal["table"] = "table"
    table: VarianceTable = PAPER_TABLE

    def __call__(self, fix: PoseFix) -> Variance:
        return self.table.row(fix.n_used)


class StaticVariance(Settings):
    """The same for every fix: one statistic of a table, the paper's comparison models."""

    kind: Literal["static"] = "static"
    statistic: Statistic
    table: VarianceTable = PAPER_TABLE

    def __call__(self, fix: PoseFix) -> Variance:
        return self.table.reduce(self.statistic)


AnyVarianceModel = Annotated[TableVariance | StaticVariance, Field(discriminator="kind")]
