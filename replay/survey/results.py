"""What a survey is asked for and what it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Array
from pipeline.markers import Marker, MarkerMap
from replay.survey.problem import ANY_EDGES, EdgePrior, Prior
from replay.survey.solve import Loss

# Each marker has six chances to be that far off by chance: with twenty, one survey in 130 names one
# that was measured well, with a hundred one in 26. At three it would be one in four with twenty.
IMPLAUSIBLE_SIGMAS = 4.0
# An inset that is further from what the detector is known to do makes up for a wrong scale: on the
# sample log, places 5 % too far apart move it by 9 standard deviations, real prints by 2.
ODD_EDGE_SIGMAS = 5.0


@dataclass(frozen=True)
class SurveyOptions:
    """How to refine a map.

    Attributes:
        fix: markers held exactly where they are.
        std_m: of the hand-measured positions, per axis, where the map gives none.
        std_deg: of the hand-measured orientations, per axis.
        max_frames: at most so many frames are used.
        edges: what the detector is expected to do to them.
    """

    fix: frozenset[int] = frozenset()
    std_m: float = 0.01
    std_deg: float = 1.0
    loss: Loss = "soft_l1"
    max_frames: int = 400
    edges: EdgePrior = ANY_EDGES


@dataclass(frozen=True, eq=False)
class SurveyedMarker:
    """One marker before and after.

    Attributes:
        seen: frames that were used for it.
        rejected: frames in which its corners were too far off to be its corners.
        shift_m, turn_rad: (3,) from the hand measurement to the refined pose, in map axes; the
            turn as axis-angle, so that its z is the change of yaw.
        shift_sigma_m, turn_sigma_rad: (3,) one standard deviation; NaN for what did not move.
    """

    hand: Marker
    refined: Marker
    fixed: bool
    prior: Prior
    seen: int
    rejected: int
    shift_m: Array
    turn_rad: Array
    shift_sigma_m: Array
    turn_sigma_rad: Array

    @property
    def id(self) -> int:
        return self.hand.id

    @property
    def yaw_rad(self) -> float:
        """By how much it turned about map z."""
        return float(self.turn_rad[2])

    @property
    def tilt_rad(self) -> float:
        """By how much it turned about an axis across map z."""
        return float(np.hypot(self.turn_rad[0], self.turn_rad[1]))

    @property
    def yaw_sigma_rad(self) -> float:
        return float(self.turn_sigma_rad[2])

    @property
    def tilt_sigma_rad(self) -> float:
        """Of its turn about one axis across map z."""
        return float(np.sqrt((self.turn_sigma_rad[:2] ** 2).mean()))

    @property
    def sigmas(self) -> float:
        """The larger of shift and turn in standard deviations of the hand measurement."""
        shift = np.abs(self.shift_m).max() / self.prior.std_m
        turn = np.abs(self.turn_rad).max() / self.prior.std_rad
        return float(max(shift, turn))

    @property
    def implausible(self) -> bool:
        """Whether it is farther from the hand measurement than its uncertainty explains."""
        return not self.fixed and self.sigmas > IMPLAUSIBLE_SIGMAS


@dataclass(frozen=True, eq=False)
class Survey:
    """A refined map and how it came about.

    Attributes:
        markers: those seen, by id.
        unseen: ids that no frame used shows; they stay as they were measured.
        disowned: ids seen only with corners that fit nowhere; they stay as well.
        contradicted: fixed ids that most images have elsewhere beside the other fixed ones; they
            stay, and count.
        groups: ids of the markers that frames tie together; between two groups there is nothing
            but the hand measurement.
        frames: used.
        rms_before_px, rms_after_px: distance of a corner from where it should be, over the
            corners used, each time with the frames' best poses.
        sigma_px: of a corner's u or v, from the median.
        edge_px: how far the detector puts edges inside the true ones.
        correlation, bias_px: as in `Uncertainty`.
    """

    refined: MarkerMap
    markers: tuple[SurveyedMarker, ...]
    unseen: tuple[int, ...]
    disowned: tuple[int, ...]
    contradicted: tuple[int, ...]
    groups: tuple[tuple[int, ...], ...]
    options: SurveyOptions
    frames: int
    observations: int
    rejected: int
    rms_before_px: float
    rms_after_px: float
    sigma_px: float
    edge_px: float
    edge_sigma_px: float
    correlation: float
    bias_px: float
    converged: bool

    @property
    def edge_sigmas(self) -> float:
        """How far the edges' inset is from the expected one, in its standard deviations."""
        edges = self.options.edges
        return abs(self.edge_px - edges.mean_px) / edges.std_px
