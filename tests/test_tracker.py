"""The tracker against algebra written out by hand, for every variance model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.geometry import Array, Pose
from pipeline.localizer import PAPER_TRACKERS
from pipeline.pose import PoseFix
from pipeline.tracker import ConstantVelocity, ConstantVelocityTracker, TrackState
from pipeline.variance import PAPER_TABLE, StaticVariance, TableVariance, VarianceTable

# Table I of the paper, in cm².
TABLE_CM2 = [
    (1944.56, 914.43),
    (603.46, 464.10),
    (68.88, 64.47),
    (19.35, 16.77),
    (7.62, 6.64),
    (4.46, 3.49),
    (3.04, 2.09),
]


def fix_at(x_m: float, y_m: float, n_markers: int) -> PoseFix:
    pose = Pose(np.eye(3), np.array([x_m, y_m, 0.3]))
    return PoseFix("ok", n_markers, tuple(range(n_markers)), n_markers, pose, 0.5, 0.5)


def variance_by_hand(name: str, n_markers: int) -> tuple[float, float]:
    """σ²x, σ²y in m² as the paper defines them."""
    x, y = ([row[axis] * 1e-4 for row in TABLE_CM2] for axis in (0, 1))
    if name == "adaptive":
        row = min(n_markers, 7) - 1
        return x[row], y[row]
    reduce = {"min": min, "max": max, "mean": np.mean, "median": lambda v: sorted(v)[3]}[name]
    return float(reduce(x)), float(reduce(y))  # type: ignore[operator]


class FilterByHand:
    """Equations 5 to 13 of the paper, written out per axis without any matrix library call."""

    def __init__(self, name: str, accel_std: float = 0.01, r_scale: float = 0.25) -> None:
        self.name, self.q, self.r_scale = name, accel_std**2, r_scale
        self.axes: list[dict[str, float]] | None = None

    def step(self, dt: float, fix: PoseFix) -> None:
        for axis in self.axes or []:
            p, v = axis["p"], axis["v"]
            a, b, c = axis["a"], axis["b"], axis["c"]
            axis["p"], axis["v"] = p + dt * v, v
            axis["a"] = a + 2 * dt * b + dt * dt * c + self.q * dt**4 / 4
            axis["b"] = b + dt * c + self.q * dt**3 / 2
            axis["c"] = c + self.q * dt**2
        if fix.status != "ok" or fix.T_map_camera is None:
            return
        variances = variance_by_hand(self.name, fix.n_used)
        z = fix.T_map_camera.translation[:2]
        if self.axes is None:
            self.axes = [
                {"p": float(z[i]), "v": 0.0, "a": variances[i], "b": 0.0, "c": 0.0} for i in (0, 1)
            ]
            return
        self.nis = 0.0
        for i, axis in enumerate(self.axes):
            s = axis["a"] + self.r_scale * variances[i]
            innovation = float(z[i]) - axis["p"]
            k_p, k_v = axis["a"] / s, axis["b"] / s
            axis["p"] += k_p * innovation
            axis["v"] += k_v * innovation
            a, b, c = axis["a"], axis["b"], axis["c"]
            axis["a"], axis["b"], axis["c"] = (1 - k_p) * a, (1 - k_p) * b, c - k_v * b
            axis["innovation"] = innovation
            self.nis += innovation**2 / s

    def state(self) -> tuple[Array, Array]:
        assert self.axes is not None
        x = np.array([value for axis in self.axes for value in (axis["p"], axis["v"])])
        P = np.zeros((4, 4))
        for i, axis in enumerate(self.axes):
            P[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [
                [axis["a"], axis["b"]],
                [axis["b"], axis["c"]],
            ]
        return x, P


def random_session(seed: int) -> list[tuple[int, PoseFix]]:
    """Fixes with gaps, rejected poses and uneven time steps; the first frames have none."""
    rng = np.random.default_rng(seed)
    stamp, session = 1_700_000_000_000_000_000, []
    for i in range(300):
        stamp += int(rng.choice([33e6, 100e6, 250e6, 2e9]) * rng.uniform(0.5, 1.5))
        n = int(rng.integers(0, 10))
        if n == 0 or i < 3:
            fix = PoseFix("no_markers")
        elif rng.random() < 0.1:
            fix = PoseFix("reprojection", n, tuple(range(n)), 0, Pose(np.eye(3), np.full(3, 1e3)))
        else:
            x, y = 0.05 * i + rng.normal(0, 0.1), rng.normal(0, 0.1)
            fix = fix_at(x, y, n)
        session.append((stamp, fix))
    return session


@pytest.mark.parametrize("name", list(PAPER_TRACKERS))
@pytest.mark.parametrize("seed", range(5))
def test_every_paper_model_equals_algebra_written_out(name: str, seed: int) -> None:
    tracker, by_hand = PAPER_TRACKERS[name].build(), FilterByHand(name)
    last = None
    updates = 0
    for stamp, fix in random_session(seed):
        by_hand.step(0.0 if last is None else (stamp - last) * 1e-9, fix)
        state = tracker.step(stamp, fix)
        last = stamp
        if by_hand.axes is None:
            assert np.isnan(state.x).all()
            continue
        x, P = by_hand.state()
        np.testing.assert_allclose(state.x, x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(state.P, P, rtol=1e-9, atol=1e-9)
        if np.isfinite(state.nis):
            updates += 1
            innovations = [axis["innovation"] for axis in by_hand.axes]
            np.testing.assert_allclose(state.innovation_m, innovations, rtol=1e-9, atol=1e-9)
            assert state.nis == pytest.approx(by_hand.nis, rel=1e-9)
    assert updates > 100


def test_the_papers_five_models_are_the_default_and_their_numbers_are_its() -> None:
    assert list(PAPER_TRACKERS) == ["adaptive", "min", "max", "mean", "median"]
    for name, settings in PAPER_TRACKERS.items():
        assert (settings.accel_std, settings.r_scale) == (0.01, 0.25)
        for n in (1, 4, 7, 24):
            assert settings.variance(fix_at(0, 0, n)) == pytest.approx(variance_by_hand(name, n))


def test_first_fix_starts_the_track_with_undivided_variances() -> None:
    tracker = ConstantVelocity().build()
    assert not tracker.step(0, PoseFix("no_markers")).updated
    state = tracker.step(100, fix_at(1.0, 2.0, 3))
    assert state.updated
    np.testing.assert_array_equal(state.x, [1.0, 0.0, 2.0, 0.0])
    np.testing.assert_allclose(state.P, np.diag([68.88e-4, 0, 64.47e-4, 0]))
    np.testing.assert_allclose(state.r_m2, [68.88e-4 / 4, 64.47e-4 / 4])
    assert np.isnan(state.innovation_m).all()
    assert np.isnan(state.nis)


def tracked(tracker: ConstantVelocityTracker, stamps: list[int]) -> list[TrackState]:
    return [tracker.step(stamp, fix_at(0.1 * i, 0.0, 5)) for i, stamp in enumerate(stamps)]


def test_stamps_that_jump_back_let_no_time_pass() -> None:
    forward = tracked(ConstantVelocity().build(), [0, 10**8, 10**8, 2 * 10**8])
    jumped = tracked(ConstantVelocity().build(), [0, 10**8, 10**7, 2 * 10**8])
    for a, b in zip(forward, jumped, strict=True):
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.P, b.P)


def test_time_goes_on_behind_a_clock_that_was_set_back() -> None:
    hour_ns = 3600 * 10**9
    forward = tracked(ConstantVelocity().build(), [0, 10**8, 10**8, 2 * 10**8, 3 * 10**8])
    stamps = [hour_ns, hour_ns + 10**8, 0, 10**8, 2 * 10**8]
    for a, b in zip(forward, tracked(ConstantVelocity().build(), stamps), strict=True):
        np.testing.assert_array_equal(a.x, b.x)
        np.testing.assert_array_equal(a.P, b.P)


def test_nis_is_chi2_when_the_model_is_true() -> None:
    """Consistency: data drawn from the filter's own model has a mean NIS of 2 within its band."""
    rng = np.random.default_rng(11)
    settings = ConstantVelocity(
        accel_std=0.2, r_scale=1.0, variance=StaticVariance(statistic="min", table=PAPER_TABLE)
    )
    sigma = np.sqrt([3.04e-4, 2.09e-4])
    nis = []
    for _ in range(40):
        tracker = settings.build()
        position, velocity, stamp = np.zeros(2), np.zeros(2), 0
        for _ in range(50):
            measured = position + rng.normal(0, sigma)
            nis.append(tracker.step(stamp, fix_at(measured[0], measured[1], 5)).nis)
            acceleration = rng.normal(0, 0.2, 2)
            position = position + 0.1 * velocity + 0.005 * acceleration
            velocity = velocity + 0.1 * acceleration
            stamp += 10**8
    values = np.array(nis)[np.isfinite(nis)]
    # Standard error of the mean of chi2(2) is 2 / sqrt(n).
    assert abs(values.mean() - 2.0) < 4 * 2.0 / np.sqrt(len(values))


@pytest.mark.parametrize(
    "settings",
    [
        {"accel_std": -1.0},
        {"r_scale": 0.0},
        {"variance": {"kind": "static"}},
        {"variance": {"kind": "static", "statistic": "mode"}},
        {"variance": {"kind": "table", "table": {"cm2": []}}},
        {"variance": {"kind": "table", "table": {"cm2": [[1.0, -1.0]]}}},
        {"unknown": 1},
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="validation error"):
        ConstantVelocity.model_validate(settings)


def test_a_table_is_clamped_to_its_last_row() -> None:
    table = VarianceTable(cm2=((4.0, 9.0), (1.0, 2.0)))
    assert TableVariance(table=table)(fix_at(0, 0, 30)) == pytest.approx((1e-4, 2e-4))
    with pytest.raises(ValueError, match="at least one marker"):
        table.row(0)
