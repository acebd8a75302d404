"""From sightings and a hand-measured map to the refined map with its uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pipeline.camera import Camera
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose, read_only
from pipeline.markers import Marker, MarkerMap
from pipeline.pose import RansacIterative
from replay.survey.keyframes import choose
from replay.survey.problem import Observations, Prior, Problem, moved_marker
from replay.survey.results import Survey, SurveyedMarker, SurveyOptions
from replay.survey.sightings import Sighting
from replay.survey.solve import Solution, solve
from replay.survey.uncertainty import Uncertainty, uncertainty
from replay.survey.views import Views

BoolArray = npt.NDArray[np.bool_]

# A corner farther off than this is no corner of that marker there; what is nearer is the loss's.
_REJECT_SIGMAS = 8.0
_REJECT_PX = 1.0
# A fixed marker of whose sightings more are that far off is where the others do not have it.
_CONTRADICTED = 0.5
_REJECT_ROUNDS = 4
# Corners of real and rendered drives fit to 0.1 to 0.4 px with maps that were 2 to 20 cm off; to
# 70 px and more with the map of another place. Of the median, so that a few markers do not decide.
_NO_FIT_PX = 5.0
# Two pixels with a known detector: no print or light does that, a scale that is 10 % off does.
_NO_EDGE_SIGMAS = 20.0
# Another start is taken where it costs clearly less.
_RESTARTS = 8
_MUCH_BETTER = 0.8
_RESTART_REPROJECTION_PX = 1000.0


def survey(
    sightings: Sequence[Sighting],
    camera: Camera,
    marker_map: MarkerMap,
    options: SurveyOptions,
    *,
    on_step: Callable[[str], None] = lambda _: None,
) -> Survey:
    """The map that fits the sightings and the hand measurement best.

    Args:
        on_step: told what is being done.

    Raises:
        ValueError: no frame shows two markers of which one may move, or `fix` names another id
            than those of the map; or no map that is anything like this one fits the corners.
    """
    unknown = sorted(options.fix - set(marker_map.ids))
    if unknown:
        raise ValueError(f"expected ids of the map to fix, found {', '.join(map(str, unknown))}")
    chosen = [sightings[i] for i in choose(sightings, marker_map, options.max_frames)]
    on_step(f"{len(chosen)} frames chosen of {len(sightings)} that see two markers")
    views = Views.of(chosen).informative(options.fix)
    rejected: Counter[int] = Counter()
    for attempt in range(_REJECT_ROUNDS):
        if not len(views.ids):
            raise ValueError(
                "expected a frame that sees two mapped markers, one of them not fixed, found none"
            )
        after = _settled(views, camera, marker_map, options, on_step)
        errors = after.problem.corner_errors_px(after.solution.x)
        gate_px = max(_REJECT_SIGMAS * after.solution.sigma_px, _REJECT_PX)
        wrong = np.linalg.norm(errors, axis=2).max(axis=1) > gate_px
        # Without it the map would hang on other markers than those it was told to: the loss weighs
        # them against each other.
        contradicted = _contradicted(views, wrong, options.fix)
        wrong &= ~np.isin(views.ids, contradicted)
        if not wrong.any() or attempt == _REJECT_ROUNDS - 1:
            break
        on_step(f"{int(wrong.sum())} of {len(wrong)} sightings are off, and left out")
        rejected.update(int(marker_id) for marker_id in views.ids[wrong])
        views = views.moved(after.poses).select(~wrong).informative(options.fix)
    _refuse_misfit(after.solution)
    views = views.moved(after.poses)
    # Corners taken as independent would overrule the priors in what they hardly know: the map's
    # scale, which only the edges' inset tells apart from the height of the ceiling.
    dependence = uncertainty(after.problem, after.solution).dependence
    shared = after.solution.x[: after.problem.frame_start]
    after = _solve(views, camera, marker_map, options, options.fix, shared, dependence)
    # What fitted by far too small a price for the priors does not any more.
    _refuse_misfit(after.solution)
    before = _solve(views, camera, marker_map, options, set(marker_map.ids))
    done = _survey(views, before, after, marker_map, options, rejected, contradicted)
    if done.edge_sigmas > _NO_EDGE_SIGMAS:
        raise ValueError(
            f"expected edges that are seen {options.edges.mean_px:.2f} px inside the true ones, "
            f"found {done.edge_px:.2f} px: are the markers' sizes and places of one scale?"
        )
    return done


def _refuse_misfit(solution: Solution) -> None:
    if solution.sigma_px > _NO_FIT_PX:
        raise ValueError(
            f"expected corners that fit to {_NO_FIT_PX:g} px, found {solution.sigma_px:.1f} px: is "
            "the map of this place and in metres, and the calibration this camera's?"
        )


def _contradicted(views: Views, wrong: BoolArray, fixed: Collection[int]) -> tuple[int, ...]:
    """The fixed markers that most of their sightings have elsewhere."""
    seen, off = Counter(views.ids.tolist()), Counter(views.ids[wrong].tolist())
    return tuple(i for i in sorted(fixed) if off[i] > _CONTRADICTED * seen[i])


def _settled(
    views: Views,
    camera: Camera,
    marker_map: MarkerMap,
    options: SurveyOptions,
    on_step: Callable[[str], None],
) -> _Solved:
    """The solution after frames that started in a wrong valley have been given another start.

    Few markers seen from far, and a map that is off, give poses that no small steps correct.
    """
    solved = _solve(views, camera, marker_map, options, options.fix)
    on_step(f"corners fit to {solved.solution.sigma_px:.3f} px")
    for _ in range(_RESTARTS):
        poses, better = _restarted(views, solved, camera, marker_map, options)
        if not better:
            break
        shared = solved.solution.x[: solved.problem.frame_start]
        solved = _solve(views.moved(poses), camera, marker_map, options, options.fix, shared)
        on_step(f"{better} frames started anew: {solved.solution.sigma_px:.3f} px")
    return solved


def _restarted(
    views: Views, solved: _Solved, camera: Camera, marker_map: MarkerMap, options: SurveyOptions
) -> tuple[tuple[Pose, ...], int]:
    """For each frame the better of its pose and the solver's from the refined map; how many."""
    problem, solution = solved.problem, solved.solution
    shifts = problem.shifts(solution.x)
    moved = [
        m if held else moved_marker(m, shift)
        for m, held, shift in zip(problem.markers, problem.fixed, shifts, strict=True)
    ]
    refined = replace(marker_map, markers=tuple(moved))
    # Whatever the solver finds is judged by its cost alone.
    solver = RansacIterative(max_reprojection_px=_RESTART_REPROJECTION_PX)
    candidates = []
    for i, pose in enumerate(solved.poses):
        rows = views.frame == i
        fix = solver(Detections(views.ids[rows], views.corners_px[rows]), camera, refined, 0.0)
        good = fix.T_map_camera is not None and fix.T_map_camera.is_finite()
        candidates.append(fix.T_map_camera.inverse() if fix.T_map_camera and good else pose)
    other = _problem(views.moved(tuple(candidates)), camera, marker_map, options, options.fix)
    x = np.concatenate(
        [solution.x[: problem.frame_start], np.zeros(problem.size - problem.frame_start)]
    )
    cost, other_cost = (
        _frame_costs(p, at, solution.sigma_px) for p, at in ((problem, solution.x), (other, x))
    )
    better = other_cost < _MUCH_BETTER * cost
    chosen = zip(candidates, solved.poses, better, strict=True)
    return tuple(new if choose_new else old for new, old, choose_new in chosen), int(better.sum())


def _frame_costs(problem: Problem, x: Array, sigma_px: float) -> Array:
    """(frames,) how badly each frame's corners fit; one that is far off counts not much more."""
    squares = ((problem.corner_errors_px(x) / sigma_px) ** 2).sum(axis=2)
    cost = (np.sqrt(1.0 + squares) - 1.0).sum(axis=1)
    frames = len(problem.starts)
    summed = np.bincount(problem.observations.frame, weights=cost, minlength=frames)
    return summed.astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Solved:
    problem: Problem
    solution: Solution

    @property
    def poses(self) -> tuple[Pose, ...]:
        return self.problem.poses(self.solution.x)

    @property
    def rms_px(self) -> float:
        errors = self.problem.corner_errors_px(self.solution.x)
        return float(np.sqrt((errors**2).sum(axis=2).mean()))


def _solve(
    views: Views,
    camera: Camera,
    marker_map: MarkerMap,
    options: SurveyOptions,
    fixed: Collection[int],
    shared: Array | None = None,
    dependence: float = 1.0,
) -> _Solved:
    """From the hand measurement, or from what `shared` says of the markers and the edges."""
    problem = _problem(views, camera, marker_map, options, fixed)
    start = problem.start
    if shared is not None:
        start[: problem.frame_start] = shared
    return _Solved(problem, solve(problem, start, options.loss, dependence))


def _problem(
    views: Views,
    camera: Camera,
    marker_map: MarkerMap,
    options: SurveyOptions,
    fixed: Collection[int],
) -> Problem:
    ids, column = np.unique(views.ids, return_inverse=True)
    markers = [marker_map.by_id[int(i)] for i in ids]
    return Problem(
        camera,
        markers,
        [marker.id in fixed for marker in markers],
        [_prior(marker, options) for marker in markers],
        views.poses,
        Observations(views.frame, column, views.corners_px),
        options.edges,
    )


def _prior(marker: Marker, options: SurveyOptions) -> Prior:
    std_m = options.std_m if marker.std_m is None else marker.std_m
    return Prior(std_m, float(np.radians(options.std_deg)))


def _survey(
    views: Views,
    before: _Solved,
    after: _Solved,
    marker_map: MarkerMap,
    options: SurveyOptions,
    rejected: Mapping[int, int],
    contradicted: tuple[int, ...],
) -> Survey:
    problem, solution = after.problem, after.solution
    sure = uncertainty(problem, solution)
    markers = _surveyed(views, after, sure, marker_map, options, rejected)
    seen = {marker.id: marker.refined for marker in markers}
    return Survey(
        refined=MarkerMap(
            marker_map.frame,
            marker_map.dictionary,
            tuple(seen.get(marker.id, marker) for marker in marker_map.markers),
            marker_map.inverted,
        ),
        markers=markers,
        unseen=tuple(i for i in marker_map.ids if i not in seen and not rejected.get(i)),
        disowned=tuple(i for i in marker_map.ids if i not in seen and rejected.get(i)),
        contradicted=contradicted,
        groups=views.groups(),
        options=options,
        frames=len(views.poses),
        observations=len(views.ids),
        rejected=sum(rejected.values()),
        rms_before_px=before.rms_px,
        rms_after_px=after.rms_px,
        sigma_px=solution.sigma_px,
        edge_px=float(solution.x[problem.edge_column]),
        edge_sigma_px=float(np.sqrt(sure.covariance[-1, -1])),
        correlation=sure.correlation,
        bias_px=sure.bias_px,
        converged=solution.converged,
    )


def _surveyed(
    views: Views,
    after: _Solved,
    sure: Uncertainty,
    marker_map: MarkerMap,
    options: SurveyOptions,
    rejected: Mapping[int, int],
) -> tuple[SurveyedMarker, ...]:
    problem = after.problem
    shifts = problem.shifts(after.solution.x)
    sigmas = np.full_like(shifts, np.nan)
    variances = np.diag(sure.covariance)[: problem.edge_column]
    sigmas[~problem.fixed] = np.sqrt(variances).reshape(-1, 6)
    markers = []
    for i, hand in enumerate(problem.markers):
        fixed = bool(problem.fixed[i])
        markers.append(
            SurveyedMarker(
                hand=hand,
                refined=hand if fixed else _refined(hand, shifts[i], sigmas[i]),
                fixed=fixed,
                prior=_prior(hand, options),
                seen=int((views.ids == hand.id).sum()),
                rejected=rejected.get(hand.id, 0),
                shift_m=read_only(shifts[i, :3]),
                turn_rad=read_only(shifts[i, 3:]),
                shift_sigma_m=read_only(sigmas[i, :3]),
                turn_sigma_rad=read_only(sigmas[i, 3:]),
            )
        )
    return tuple(markers)


def _refined(hand: Marker, shift: Array, sigma: Array) -> Marker:
    """With the standard deviation of a coordinate."""
    return replace(moved_marker(hand, shift), std_m=float(np.sqrt((sigma[:3] ** 2).mean())))
