"""How well a lens explains views that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.camera import DistortionModel
from pipeline.geometry import Array
from replay.calibration.fit import Fit, fit_lens, fit_pose, rms
from replay.calibration.lens import COEFFICIENTS, Lens
from replay.calibration.start import first_fit
from replay.calibration.views import View

FOLDS = 10
# From the fit to all views the one to most of them is near.
_MOST_STEPS = 30
HOW = (
    "the views used, without those set aside because they do not fit, in {folds} parts; each "
    "part's views are projected by the lens fitted to the other parts, after fitting only the "
    "board's pose to their own corners"
)

# Lenses of fewer parameters within each model, by the coefficients that they leave at zero.
_SIMPLER: dict[DistortionModel, tuple[tuple[DistortionModel, tuple[str, ...]], ...]] = {
    "plumb_bob": (("plumb_bob", ("k3",)),),
    "rational_polynomial": (("plumb_bob", ("k3",)), ("plumb_bob", ())),
    "equidistant": (("equidistant", ("k3", "k4")),),
}
# Within half a per cent two lenses explain views equally well: differences of corners, not of them.
_AS_WELL = 1.005
_BETTER = 0.9


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of the views, each under a lens that was fitted to others.

    Attributes:
        view_rms_px: (V,) of each view; infinite where its pose cannot be found.
    """

    rms_px: float
    view_rms_px: Array
    folds: int


@dataclass(frozen=True)
class Candidate:
    """A lens and how it does; errors are None where it cannot be fitted."""

    lens: Lens
    rms_px: float | None
    heldout_rms_px: float | None
    simpler: bool

    @property
    def parameters(self) -> int:
        return int(self.lens.free.sum())


def held_out(fit: Fit, views: Sequence[View]) -> HeldOut:
    """Cross-validation from a fit to all the views; view i is in part i modulo the parts."""
    folds = min(FOLDS, len(views))
    errors = np.full(len(views), np.inf)
    squares, count = 0.0, 0
    for fold in range(folds):
        others = [i for i in range(len(views)) if i % folds != fold]
        trained = fit_lens(
            fit.lens,
            [views[i] for i in others],
            fit.values,
            fit.poses[others],
            most_steps=_MOST_STEPS,
        )
        for i in range(fold, len(views), folds):
            pose = fit_pose(fit.lens, trained.values, views[i], fit.poses[i])
            projected = (
                fit.lens.project(trained.values, pose, views[i].points_m)
                if pose is not None
                else None
            )
            if projected is not None:
                errors[i] = rms(views[i].pixels - projected[0])
            squares += errors[i] ** 2 * len(views[i].pixels)
            count += len(views[i].pixels)
    return HeldOut(float(np.sqrt(squares / count)), errors, folds)


def candidates(
    fit: Fit, held: HeldOut, views: Sequence[View], image_size: tuple[int, int]
) -> tuple[Candidate, ...]:
    """The fitted lens, simpler ones within it, and the other models, all on the same views."""
    chosen = fit.lens
    found = [Candidate(chosen, fit.rms_px, held.rms_px, False)]
    simpler = [Lens(model, _zero(model, chosen, names)) for model, names in _SIMPLER[chosen.model]]
    others = [Lens(model, _zero(model, chosen, ())) for model in COEFFICIENTS]
    for lens in dict.fromkeys((*simpler, *others)):
        if lens == chosen:
            continue
        is_simpler = lens in simpler and lens.free.sum() < chosen.free.sum()
        other = _fit_like(fit, lens, views, image_size)
        if other is None:
            found.append(Candidate(lens, None, None, is_simpler))
            continue
        rms_px = held_out(other, views).rms_px
        found.append(
            Candidate(lens, other.rms_px, rms_px if np.isfinite(rms_px) else None, is_simpler)
        )
    return tuple(found)


def as_good_and_simpler(found: Sequence[Candidate]) -> Candidate | None:
    """The one of fewest parameters that does as well on held-out views as the first, if any."""
    limit = _AS_WELL * (found[0].heldout_rms_px or 0.0)
    as_good = [
        c for c in found if c.simpler and c.heldout_rms_px is not None and c.heldout_rms_px <= limit
    ]
    return min(as_good, key=lambda c: c.parameters, default=None)


def better(found: Sequence[Candidate]) -> Candidate | None:
    """The one that does best on held-out views, if it is clearly better than the first."""
    limit = _BETTER * (found[0].heldout_rms_px or 0.0)
    good = [c for c in found if c.heldout_rms_px is not None and c.heldout_rms_px < limit]
    return min(good, key=lambda c: c.heldout_rms_px or 0.0, default=None)


def _fit_like(
    fit: Fit, lens: Lens, views: Sequence[View], image_size: tuple[int, int]
) -> Fit | None:
    """Another lens fitted to all the views; None where that cannot be."""
    if (lens.model == "equidistant") == (fit.lens.model == "equidistant"):
        # One model holds the other: what they share is where to begin.
        own = dict(zip(fit.lens.names, fit.values, strict=True))
        values = np.array([0.0 if n in lens.zero else own.get(n, 0.0) for n in lens.names])
        return fit_lens(lens, views, values, fit.poses, most_steps=_MOST_STEPS)
    found = first_fit(lens, views, image_size)
    return found[0] if found is not None and len(found[1]) == len(views) else None


def _zero(model: DistortionModel, chosen: Lens, names: Sequence[str]) -> frozenset[str]:
    """What a person asked to leave at zero, and `names`."""
    asked = chosen.zero if (model == "equidistant") == (chosen.model == "equidistant") else ()
    return frozenset(names) | (frozenset(asked) & frozenset(COEFFICIENTS[model]))
