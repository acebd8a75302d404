"""Statistics by hand-worked numbers; the bootstrap's coverage on a known distribution."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.static.statistics import STATISTICS, Bootstrap, statistics, wilson


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
    two_markers = Bootstrap(resamples=50).intervals(np.ones((10, 2)))
    assert all(np.isnan(ends).all() for ends in two_markers.values())


def test_a_marker_without_a_fix_is_no_marker() -> None:
    errors = np.ones((5, 3))
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


def test_intervals_are_seeded_and_do_not_depend_on_how_they_are_cut() -> None:
    errors = np.random.default_rng(2).normal(size=(6, 8))
    assert Bootstrap(300, seed=5).intervals(errors) == Bootstrap(300, seed=5).intervals(errors)
    assert Bootstrap(300, seed=5).intervals(errors) != Bootstrap(300, seed=6).intervals(errors)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Errors with a part of the frame and one of the marker; 95 % intervals of mean and RMSE."""
    rng = np.random.default_rng(7)
    bias, frame_std, marker_std, noise = 0.5, 0.5, 1.0, 0.7
    rmse = np.sqrt(bias**2 + frame_std**2 + marker_std**2 + noise**2)
    trials, held = 250, {"bias": 0, "rmse": 0}
    for trial in range(trials):
        errors = (
            bias
            + rng.normal(0, frame_std, (15, 1))
            + rng.normal(0, marker_std, (1, 16))
            + rng.normal(0, noise, (15, 16))
        )
        found = Bootstrap(400, seed=trial).intervals(errors)
        for name, true in (("bias", bias), ("rmse", rmse)):
            low, high = found[name]
            held[name] += low <= true <= high
    # The mean's is as wide as Student's t; a root mean square is skewed and falls a little short.
    assert 0.92 <= held["bias"] / trials <= 0.99
    assert 0.87 <= held["rmse"] / trials <= 0.99


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
