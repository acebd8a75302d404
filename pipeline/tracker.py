"""From position fixes to a trajectory: the paper's constant-velocity Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from filterpy.kalman import KalmanFilter
from pydantic import Field, NonNegativeFloat, PositiveFloat

from pipeline.geometry import Array
from pipeline.pose import PoseFix
from pipeline.settings import Settings
from pipeline.variance import AnyVarianceModel, TableVariance

# Picks x and y from the state [x, vx, y, vy].
H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])

# Frames out of order are not that far out of it.
_SET_BACK_NS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class TrackState:
    """A tracker's state after one frame; all NaN before its first fix.

    Attributes:
        updated: this frame's fix was used (also the first, that starts the track).
        x: (4,) x, vx, y, vy in m and m/s.
        P: (4, 4) covariance of x.
        r_m2: (2,) measurement variance of x and y, after scaling; NaN where nothing updates.
        innovation_m: (2,) fix minus prediction; NaN where nothing updates and for the first fix.
        innovation_var_m2: (2,) diagonal of the innovation covariance S, likewise.
        nis: normalized innovation squared, likewise.
    """

    updated: bool
    x: Array
    P: Array
    r_m2: Array
    innovation_m: Array
    innovation_var_m2: Array
    nis: float


class ConstantVelocity(Settings):
    """Constant velocity disturbed by white acceleration, constant within a frame (DWNA)."""

    kind: Literal["constant_velocity"] = "constant_velocity"
    accel_std: NonNegativeFloat = Field(default=0.01, description="m/s²")
    r_scale: PositiveFloat = Field(
        default=0.25, description="R = r_scale times the variances; the paper's 1/4"
    )
    variance: AnyVarianceModel = TableVariance()

    def build(self) -> ConstantVelocityTracker:
        return ConstantVelocityTracker(self)


class ConstantVelocityTracker:
    """Tracks x and y through a log; fixes that are not `ok` only let time pass.

    Source: Hinderer, Scheffler, Yang, ICAR 2025, section IV.
    """

    def __init__(self, settings: ConstantVelocity) -> None:
        self._settings = settings
        self._timestamp_ns: int | None = None
        # filterpy with 1-D x and z throughout: a column x is silently corrupted by a 1-D z.
        self._filter = KalmanFilter(dim_x=4, dim_z=2)
        self._filter.x = np.full(4, np.nan)
        self._filter.P = np.full((4, 4), np.nan)
        self._filter.H = H
        self._started = False

    def step(self, timestamp_ns: int, fix: PoseFix) -> TrackState:
        """Advances to a frame captured at `timestamp_ns` and uses its fix.

        A stamp that is not later than the latest one lets no time pass. One that is more than a
        second earlier is of a clock that was set back: time goes on from there.
        """
        dt = self._advance(timestamp_ns)
        if self._started and dt > 0:
            self._filter.predict(F=transition(dt), Q=process_noise(dt, self._settings.accel_std))
        if fix.status != "ok" or fix.T_map_camera is None:
            return self._state(updated=False)
        z = fix.T_map_camera.translation[:2].copy()
        variance = np.array(self._settings.variance(fix))
        r_m2 = self._settings.r_scale * variance
        if not self._started:
            self._started = True
            self._filter.x = np.array([z[0], 0.0, z[1], 0.0])
            self._filter.P = np.diag([variance[0], 0.0, variance[1], 0.0])
            return self._state(updated=True, r_m2=r_m2)
        self._filter.update(z, R=np.diag(r_m2))
        innovation: Array = np.array(self._filter.y)
        S: Array = np.array(self._filter.S)
        nis = float(innovation @ np.linalg.solve(S, innovation))
        return self._state(True, r_m2, innovation, S.diagonal().copy(), nis)

    def _advance(self, timestamp_ns: int) -> float:
        """Seconds since the last frame, never negative."""
        if self._timestamp_ns is None:
            self._timestamp_ns = timestamp_ns
            return 0.0
        passed_ns = max(timestamp_ns - self._timestamp_ns, 0)
        set_back = self._timestamp_ns - timestamp_ns > _SET_BACK_NS
        self._timestamp_ns = timestamp_ns if set_back else self._timestamp_ns + passed_ns
        return passed_ns * 1e-9

    def _state(
        self,
        updated: bool,
        r_m2: Array | None = None,
        innovation_m: Array | None = None,
        innovation_var_m2: Array | None = None,
        nis: float = np.nan,
    ) -> TrackState:
        nan = np.full(2, np.nan)
        return TrackState(
            updated,
            np.array(self._filter.x, dtype=np.float64),
            np.array(self._filter.P, dtype=np.float64),
            nan if r_m2 is None else r_m2,
            nan if innovation_m is None else innovation_m,
            nan if innovation_var_m2 is None else innovation_var_m2,
            nis,
        )


def transition(dt_s: float) -> Array:
    """F (4, 4) of the state [x, vx, y, vy]."""
    axis = np.array([[1.0, dt_s], [0.0, 1.0]])
    return np.asarray(np.kron(np.eye(2), axis), dtype=np.float64)


def process_noise(dt_s: float, accel_std: float) -> Array:
    """Q (4, 4): discrete white noise acceleration (Bar-Shalom et al. 2001, p. 273)."""
    axis = np.array([[dt_s**4 / 4.0, dt_s**3 / 2.0], [dt_s**3 / 2.0, dt_s**2]])
    return np.asarray(np.kron(np.eye(2), axis * accel_std**2), dtype=np.float64)
