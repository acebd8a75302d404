"""How much a position fix is trusted: the measurement variances of the tracker."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple, Protocol, Self

import numpy as np
from pydantic import (
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    SerializeAsAny,
    field_validator,
    model_validator,
)

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


class FittedVariance(Settings):
    """By the number of markers used, from one's own measurements: never the paper's table.

    They are honest variances: such a tracker's `r_scale` is 1, not the paper's 1/4.
    """

    kind: Literal["fitted"] = "fitted"
    table: VarianceTable

    def __call__(self, fix: PoseFix) -> Variance:
        return self.table.row(fix.n_used)


class DistanceCountVariance(Settings):
    """σ² = scale · d² / n^power, for n markers whose centres are d away on average.

    The defaults are a least-squares fit of log σ² to the paper's table (24 markers at a height of
    2.991 m: d = 3.05 m), which they meet within a factor of 2.5.
    """

    kind: Literal["distance_count"] = "distance_count"
    scale_cm2_per_m2: tuple[PositiveFloat, PositiveFloat] = Field(
        default=(304.0, 229.0), description="x, y: σ² in cm² of one marker at 1 m"
    )
    power: NonNegativeFloat = Field(default=3.5, description="how fast more markers help")
    max_markers: PositiveInt = Field(
        default=7, description="more than these help no further: the paper's table ends there"
    )

    def __call__(self, fix: PoseFix) -> Variance:
        distance_m = _known(fix.mean_distance_m, "mean_distance_m")
        n = min(fix.n_used, self.max_markers)
        if n < 1:
            raise ValueError(f"expected at least one marker, found {n}")
        x_cm2, y_cm2 = (scale * distance_m**2 / n**self.power for scale in self.scale_cm2_per_m2)
        return Variance(x_cm2 * 1e-4, y_cm2 * 1e-4)


CountVariance = Annotated[
    TableVariance | StaticVariance | FittedVariance | DistanceCountVariance,
    Field(discriminator="kind"),
]


class ReprojectionVariance(Settings):
    """Another model's variance times the square of how much worse the markers fit than expected.

    The six numbers of a pose take a share of the residual with them: of n markers it is expected
    to be `expected_px`·√((8n - 6) / 8n), or one marker would seem to fit twice as well as many do.
    """

    kind: Literal["reprojection"] = "reprojection"
    base: CountVariance = TableVariance()
    expected_px: PositiveFloat = Field(
        default=0.75, description="rms of many markers' corners; `contour` on clean images: 0.75"
    )
    min_factor: PositiveFloat = Field(
        default=0.25, description="a fit may be good by chance, above all of one marker"
    )
    max_factor: PositiveFloat = 100.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_factor > self.max_factor:
            raise ValueError(
                f"expected min_factor up to max_factor, found {self.min_factor} above "
                f"{self.max_factor}"
            )
        return self

    def __call__(self, fix: PoseFix) -> Variance:
        rms_px = _known(fix.reprojection_rms_px, "reprojection_rms_px")
        observations = 8 * max(fix.n_explained, 1)
        expected2 = self.expected_px**2 * (observations - 6) / observations
        factor = min(max(rms_px**2 / expected2, self.min_factor), self.max_factor)
        x_m2, y_m2 = self.base(fix)
        return Variance(x_m2 * factor, y_m2 * factor)


class CustomVariance(Settings):
    """Base of a model of one's own: a subclass with its settings as fields, and a call.

    An instance goes into a tracker: `ConstantVelocity(variance=MyModel(…))`. Settings files name
    the class, `{kind: custom, name: MyModel, …}`; they are read back as it where a program has
    defined it, elsewhere as an `UnknownVariance`, so that results can be looked at anywhere.
    """

    kind: Literal["custom"] = "custom"
    name: str = Field(default="", description="of the class; filled in by itself")

    def __call__(self, fix: PoseFix) -> Variance:
        raise NotImplementedError(f"expected {type(self).__name__} to define __call__")

    @model_validator(mode="wrap")
    @classmethod
    def _as_its_class(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Any:
        if not isinstance(data, dict):
            return handler(data)
        if cls is not CustomVariance:
            name = data.get("name", cls.__name__)
            if name != cls.__name__:
                raise ValueError(f"expected the name {cls.__name__}, found {name!r}")
            return handler({**data, "name": cls.__name__})
        models = {model.__name__: model for model in _subclasses(CustomVariance)}
        model = models.get(str(data.get("name")), UnknownVariance)
        return model.model_validate(data)


class UnknownVariance(CustomVariance):
    """A model of someone's own whose class is not defined here: its settings, and no call."""

    model_config = ConfigDict(extra="allow")

    @model_validator(mode="wrap")
    @classmethod
    def _as_its_class(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Any:
        if isinstance(data, dict) and not data.get("name"):
            raise ValueError("expected the name of a class, found none")
        return handler(data)

    def __call__(self, fix: PoseFix) -> Variance:
        raise ValueError(
            f"expected a class {self.name} derived from CustomVariance, found none; replay with "
            "the program that defines it"
        )


AnyVarianceModel = Annotated[
    TableVariance
    | StaticVariance
    | FittedVariance
    | DistanceCountVariance
    | ReprojectionVariance
    | SerializeAsAny[CustomVariance],
    Field(discriminator="kind"),
]


def _known(value: float, name: str) -> float:
    if not np.isfinite(value):
        raise ValueError(f"expected {name} in the fix, found {value}")
    return value


def _subclasses(cls: type[CustomVariance]) -> Iterator[type[CustomVariance]]:
    """All of them, the latest defined last."""
    for model in cls.__subclasses__():
        yield model
        yield from _subclasses(model)
