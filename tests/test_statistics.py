"""Statistics by hand-worked numbers; the bootstrap's coverage on a known distribution."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.static.statistics import MIN_MARKERS, STATISTICS, Bootstrap, statistics, wilson
from pipeline.geometry import Array


def test_statistics_by_hand() -> None:
    found = statistics(np.array([3.0, -1.0, np.nan, 1.0, -5.0]))
    # Sum -2, sum of squares 36, magnitudes 1 1 3 5: 0.95 of the way from first to last is 2.85.
    assert found["bias"] == pytest.approx(-0.5)
    assert found["rmse"] == pytest.approx(3.0)
    assert found["std"] == pytest.approx(np.sqrt(9.0 - 0.25))
    assert found["max"] == 5.0
    assert found["q95"] == pytest.approx(3.0 + 0.85 * 2.0)


def test_rmse_is_bias_and_spread_together() -> None:
    errors = np.random.default_rng(1).normal(0.7, 2.0, (9, 13))
    found = statistics(errors)
    assert found["rmse"] ** 2 == pytest.approx(found["bias"] ** 2 + found["std"] ** 2, rel=1e-12)


def test_too_little_for_a_statistic_is_empty_not_zero() -> None:
    assert all(np.isnan(v) for v in statistics(np.array([np.nan])).values())
    one = statistics(np.array([2.0]))
    assert np.isnan(one["std"])
    assert one["rmse"] == one["max"] == 2.0
    few = np.random.default_rng(1).normal(size=(10, MIN_MARKERS))
    assert np.isfinite([*Bootstrap(resamples=50).intervals(few).values()]).all()
    fewer = Bootstrap(resamples=50).intervals(few[:, 1:])
    assert all(np.isnan(ends).all() for ends in fewer.values())


def test_a_marker_without_a_fix_is_no_marker() -> None:
    errors = np.random.default_rng(1).normal(size=(5, MIN_MARKERS))
    errors[:, 1] = np.nan
    assert np.isnan(Bootstrap(resamples=50).intervals(errors)["rmse"]).all()


def test_resamples_are_statistics_of_repeated_cells() -> None:
    """The weighted statistics equal those of cells that really are repeated, gaps included."""
    rng = np.random.default_rng(4)
    errors = rng.normal(0.3, 1.0, (4, 5))
    errors[1, 2] = errors[3, 0] = np.nan
    frames, markers = np.array([2.0, 0, 1, 1]), np.array([1.0, 3, 0, 1, 0])
    found = Bootstrap._statistics(errors, frames[None], markers[None])
    repeated = np.repeat(np.repeat(errors, frames.astype(int), 0), markers.astype(int), 1)
    expected = statistics(repeated)
    for name, value in zip(STATISTICS, found, strict=True):
        assert value[0] == pytest.approx(expected[name], abs=1e-12), name


def test_intervals_are_seeded_and_do_not_depend_on_how_they_are_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    errors = np.random.default_rng(2).normal(size=(6, 8))
    found = Bootstrap(300, seed=5).intervals(errors)
    assert Bootstrap(300, seed=5).intervals(errors) == found
    assert Bootstrap(300, seed=6).intervals(errors) != found
    # Fifty resamples of 48 cells at a time, then one.
    for chunk in (2400, 1):
        monkeypatch.setattr("analysis.static.statistics._CHUNK", chunk)
        cut = Bootstrap(300, seed=5).intervals(errors)
        for name, ends in found.items():
            assert cut[name] == pytest.approx(ends, rel=1e-12), name


@pytest.mark.parametrize("n_markers", [4, 8, 16])
@pytest.mark.parametrize(("kind", "least"), [("normal", 0.92), ("laplace", 0.88)])
def test_intervals_hold_the_truth_as_often_as_they_say(
    kind: str, least: float, n_markers: int
) -> None:
    """Errors that are the marker's own, as one marker's mostly are: four frames are no sixteen."""
    rng = np.random.default_rng(7)
    bias, noise, trials = 0.5, 0.3, 150

    def own(shape: tuple[int, ...]) -> Array:
        return rng.normal(size=shape) if kind == "normal" else rng.laplace(size=shape) / np.sqrt(2)

    many = np.abs(bias + own((200_000,)) + rng.normal(0, noise, 200_000))
    true = {
        "bias": bias,
        "rmse": np.sqrt(bias**2 + 1 + noise**2),
        "std": np.sqrt(1 + noise**2),
        "q95": np.quantile(many, 0.95),
    }
    held = dict.fromkeys(true, 0.0)
    for trial in range(trials):
        errors = bias + own((1, n_markers)) + rng.normal(0, noise, (4, n_markers))
        found = Bootstrap(200, seed=trial).intervals(errors)
        for name, value in true.items():
            low, high = found[name]
            held[name] += (low <= value <= high) / trials
    assert min(held.values()) >= least, held


@pytest.mark.parametrize("n_markers", [4, 16])
def test_the_interval_of_a_share_holds_it(n_markers: int) -> None:
    """Markers that are always above, never, or now and then."""
    rng, trials, held = np.random.default_rng(8), 150, 0.0
    for trial in range(trials):
        own = rng.beta(0.2, 0.6, (1, n_markers))
        flags = (rng.random((6, n_markers)) < own).astype(float)
        low, high = Bootstrap(200, seed=trial).share_interval(flags)
        held += (low <= 0.25 <= high) / trials
    assert held >= 0.92


def test_a_share_of_none_or_all_is_not_certain() -> None:
    low, high = Bootstrap(50).share_interval(np.zeros((100, 8)))
    assert (low, high) == wilson(0, 8)
    assert Bootstrap(50).share_interval(np.ones((100, 8))) == pytest.approx((1 - high, 1.0))
    assert np.isnan(Bootstrap(50).share_interval(np.zeros((100, 3)))).all()


def test_where_all_err_the_same_there_is_no_interval() -> None:
    found = Bootstrap(50).intervals(np.full((6, 8), 0.1))
    assert all(np.isnan(ends).all() for ends in found.values()), found


def test_the_interval_of_the_largest_error_is_what_resampling_gives() -> None:
    errors = np.random.default_rng(9).normal(size=(6, 8))
    low, high = Bootstrap(500).intervals(errors)["max"]
    assert 0 < low < high <= np.abs(errors).max()


def test_markers_matter_more_than_frames_when_they_differ_more() -> None:
    """Many frames do not make up for few markers, as a plain bootstrap over cells would have it."""
    rng = np.random.default_rng(3)
    errors = rng.normal(0, 1.0, (1, 8)) + rng.normal(0, 0.01, (200, 8))
    low, high = Bootstrap(500).intervals(errors)["bias"]
    assert high - low > 1.5 * errors.mean(axis=0).std(ddof=1) / np.sqrt(8) * 2


def test_wilson_by_its_formula() -> None:
    # 4 of 8 at 95 %: centre 1/2, half width z sqrt(1/32 + z²/256) / (1 + z²/8).
    z = 1.959963984540054
    half = z * np.sqrt(1 / 32 + z * z / 256) / (1 + z * z / 8)
    assert wilson(4, 8) == pytest.approx((0.5 - half, 0.5 + half))
    low, high = wilson(0, 8)
    assert low == 0.0
    assert high == pytest.approx(z * z / (8 + z * z))
    assert np.isnan(wilson(0, 0)).all()
