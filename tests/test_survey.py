"""The bundle adjustment against exact worlds: its derivatives, its answer, its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.bundle import inward_px, project_with_jacobian, rotations
from pipeline.camera import DistortionModel
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose
from pipeline.markers import CORNER_SIGNS, Marker, MarkerMap
from pipeline.pose import RansacIterative
from replay.survey.keyframes import choose
from replay.survey.problem import EdgePrior, Observations, Prior, Problem
from replay.survey.report import refined_yaml, survey_text, warnings
from replay.survey.results import IMPLAUSIBLE_SIGMAS, Survey, SurveyOptions
from replay.survey.sightings import FrameCount, Sighter, Sighting
from replay.survey.solve import Loss
from replay.survey.survey import survey
from tests import worlds

CAMERA = worlds.camera()
HAND = worlds.ceiling(3, 4)
FIXED = frozenset({0, 11})


def misplaced(
    hand: MarkerMap, seed: int, *, fixed: frozenset[int] = FIXED, std_m: float = 0.01
) -> MarkerMap:
    """Where the markers truly are: off by `std_m` and 1 degree about each axis."""
    rng = np.random.default_rng(seed)
    markers = []
    for marker in hand.markers:
        shift, turn = rng.normal(0, std_m, 3), rng.normal(0, np.radians(1.0), 3)
        if marker.id not in fixed:
            T = marker.T_map_marker
            turned = Pose.from_rvec_tvec(turn, np.zeros(3)).rotation @ T.rotation
            pose = Pose(turned, T.translation + shift)
            marker = Marker.from_pose(marker.id, pose, marker.size_m, marker.std_m, marker.tags)
        markers.append(marker)
    return replace(hand, markers=tuple(markers))


def loop(n_frames: int, radius_m: float = 0.6) -> list[Pose]:
    """Once around below the ceiling, with small tilts."""
    poses = []
    for angle in np.linspace(0, 2 * np.pi, n_frames, endpoint=False):
        tilt = Pose.from_rvec_tvec((0.04 * np.sin(3 * angle), 0.05 * np.cos(angle), 0), (0, 0, 0))
        x, y = 1.2 * radius_m * np.cos(angle), radius_m * np.sin(angle)
        poses.append(worlds.looking_up(x, y, 0.4, 1.5 * angle) @ tilt)
    return poses


def seen(
    true: MarkerMap,
    hand: MarkerMap,
    poses: Sequence[Pose],
    *,
    sigma_px: float = 0.0,
    inset_px: float = 0.0,
    wrong: float = 0.0,
    seed: int = 0,
    fixed: frozenset[int] = FIXED,
) -> list[Sighting]:
    """What a survey gets: corners with noise, edges moved inwards, a share of corners wrong."""
    rng = np.random.default_rng([seed, 1])
    sighter = Sighter(CAMERA, hand, fixed, RansacIterative())
    sightings = []
    for i, pose in enumerate(poses):
        exact = worlds.corners(pose, CAMERA, true)
        corners = exact.corners_px + inset_px * inward_px(exact.corners_px)
        corners = corners + rng.normal(0, sigma_px, corners.shape)
        off = rng.random(corners.shape[:2]) < wrong
        corners[off] += rng.normal(0, 15.0, (int(off.sum()), 2))
        sighting = sighter(0, i, Detections(exact.ids, corners))
        if sighting is not None:
            sightings.append(sighting)
    return sightings


def errors(found: MarkerMap, true: MarkerMap, leave_out: frozenset[int] = FIXED) -> Array:
    """(markers, 6) position error, and rotation error as axis-angle, in map axes."""
    rows = []
    for marker in true.markers:
        if marker.id not in leave_out:
            at = found.by_id[marker.id]
            turn = at.T_map_marker.rotation @ marker.T_map_marker.rotation.T
            rows.append([*(at.centre_m - marker.centre_m), *Pose(turn, np.zeros(3)).rvec])
    return np.array(rows)


def rms_m(found: MarkerMap, true: MarkerMap, leave_out: frozenset[int] = FIXED) -> float:
    return float(np.sqrt((errors(found, true, leave_out)[:, :3] ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("model", worlds.COEFFICIENTS)
def test_projection_derivative(model: DistortionModel) -> None:
    camera = worlds.camera(model)
    points = np.random.default_rng(0).uniform(-0.6, 0.6, (30, 3)) + np.array([0, 0, 1.6])
    pixels, slopes = project_with_jacobian(camera, points)
    np.testing.assert_allclose(pixels, camera.project(points), rtol=0, atol=1e-9)
    step = 1e-6
    for axis in range(3):
        by = step * np.eye(3)[axis]
        numeric = (camera.project(points + by) - camera.project(points - by)) / (2 * step)
        np.testing.assert_allclose(slopes[:, :, axis], numeric, rtol=0, atol=1e-5)


def test_rotation_derivative() -> None:
    """Also at no rotation at all, and where the series takes over."""
    rng = np.random.default_rng(1)
    vectors = np.concatenate(
        [rng.normal(0, 1, (5, 3)), rng.normal(0, 3e-5, (3, 3)), np.zeros((1, 3))]
    )
    exp, left = rotations(vectors)
    for vector, rotation, jacobian in zip(vectors, exp, left, strict=True):
        expected = Pose.from_rvec_tvec(vector, np.zeros(3)).rotation
        np.testing.assert_allclose(rotation, expected, rtol=0, atol=1e-12)
        for axis in range(3):
            by = 1e-6 * np.eye(3)[axis]
            ahead, behind = rotations(np.stack([vector + by, vector - by]))[0]
            turn = (ahead @ behind.T - behind @ ahead.T) / 2
            numeric = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / 2e-6
            np.testing.assert_allclose(jacobian[:, axis], numeric, rtol=0, atol=1e-6)


def test_inward() -> None:
    """A square's corners move along its diagonals; a turned one's likewise."""
    square = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]])
    np.testing.assert_allclose(inward_px(square[None])[0], [[1, 1], [-1, 1], [-1, -1], [1, -1]])
    # Of a rhomb the edges move by a pixel all the same.
    rhomb = np.array([[0.0, 0.0], [50.0, 0.0], [70.0, 40.0], [20.0, 40.0]])
    moved = rhomb + inward_px(rhomb[None])[0]
    for i in range(4):
        along = (rhomb[(i + 1) % 4] - rhomb[i]) / np.linalg.norm(rhomb[(i + 1) % 4] - rhomb[i])
        for corner in (moved[i], moved[(i + 1) % 4]):
            offset = corner - rhomb[i]
            assert abs(along[0] * offset[1] - along[1] * offset[0]) == pytest.approx(1.0)


def small_problem(model: DistortionModel) -> Problem:
    """Three frames of four markers, of which one is held and one was measured by its corners."""
    camera = worlds.camera(model)
    hand = worlds.ceiling(2, 2)
    bent = np.array(hand.markers[0].corners_m)
    bent[0] += (0.002, -0.001, 0.001)
    markers = (Marker.from_corners(0, bent), *hand.markers[1:])
    poses = [worlds.looking_up(0.1 * i, -0.1, 0.5, i) for i in range(3)]
    found = [worlds.corners(pose, camera, hand) for pose in poses]
    assert all(len(f) == 4 for f in found)
    return Problem(
        camera,
        markers,
        [True, False, False, False],
        [Prior(0.01, 0.02), Prior(0.01, 0.02), Prior(0.002, 0.01), Prior(0.03, 0.05)],
        [pose.inverse() for pose in poses],
        Observations(
            np.repeat(np.arange(3), 4),
            np.concatenate([f.ids for f in found]),
            np.concatenate([f.corners_px for f in found]),
        ),
    )


@pytest.mark.parametrize("model", worlds.COEFFICIENTS)
def test_jacobian_against_differences(model: DistortionModel) -> None:
    """Every parameter, away from the start, where all rotations matter."""
    problem = small_problem(model)
    x = np.random.default_rng(2).normal(0, 0.05, problem.size)
    jacobian = problem.jacobian(x, 0.3).toarray()
    assert jacobian.shape == (len(problem.residuals(x, 0.3)), problem.size)
    for i in range(problem.size):
        step = 1e-6 * np.eye(problem.size)[i]
        numeric = (problem.residuals(x + step, 0.3) - problem.residuals(x - step, 0.3)) / 2e-6
        scale = np.abs(numeric).max()
        np.testing.assert_allclose(jacobian[:, i], numeric, rtol=0, atol=1e-6 * scale)


def test_problem_at_its_start() -> None:
    """Held corners count as they were measured, free ones as a square; no shift is no residual."""
    problem = small_problem("plumb_bob")
    residuals = problem.residuals(problem.start, 1.0)
    corner_errors = residuals[: problem.corner_rows].reshape(3, 4, 4, 2)
    assert np.abs(corner_errors[:, 0, 0]).max() > 0.3
    np.testing.assert_allclose(corner_errors[:, 0, 1:], 0, atol=1e-6)
    np.testing.assert_allclose(corner_errors[:, 1:], 0, atol=1e-6)
    assert not residuals[problem.corner_rows :].any()


@pytest.mark.parametrize(
    "loss",
    [
        "soft_l1",
        pytest.param("huber", marks=pytest.mark.slow),
        pytest.param("cauchy", marks=pytest.mark.slow),
        "linear",
    ],
)
def test_exact_corners_give_the_true_map(loss: Loss) -> None:
    true = misplaced(HAND, 3)
    found = survey(seen(true, HAND, loop(24)), CAMERA, HAND, SurveyOptions(FIXED, loss=loss))
    assert rms_m(HAND, true) > 0.01
    assert np.abs(errors(found.refined, true)).max() < 1e-6
    assert found.converged
    assert found.rms_after_px < 1e-4 < 1 < found.rms_before_px
    for marker_id in FIXED:
        assert found.refined.by_id[marker_id] is HAND.by_id[marker_id]


def test_inset_edges_are_made_up_for() -> None:
    """Corners half a pixel inside, as CONTOUR gives them, would move the map by centimetres."""
    true = misplaced(HAND, 4)
    found = survey(seen(true, HAND, loop(24), inset_px=0.5), CAMERA, HAND, SurveyOptions(FIXED))
    assert found.edge_px == pytest.approx(0.5, abs=0.002)
    assert rms_m(found.refined, true) < 2e-4


@pytest.mark.slow
def test_uncertainty_is_honest() -> None:
    """Over seeds, errors over their standard deviations have one of about one."""
    pulls = []
    for seed in range(8):
        true = misplaced(HAND, 100 + seed)
        sightings = seen(true, HAND, loop(24), sigma_px=0.3, seed=seed)
        found = survey(sightings, CAMERA, HAND, SurveyOptions(FIXED))
        sigmas = [[*m.shift_sigma_m, *m.turn_sigma_rad] for m in found.markers if not m.fixed]
        pulls.append(errors(found.refined, true) / np.array(sigmas))
        assert found.sigma_px == pytest.approx(0.3, rel=0.1)
        assert found.bias_px < 0.1
    spread = np.sqrt((np.concatenate(pulls) ** 2).mean(axis=0))
    assert (spread > 0.7).all(), spread
    assert (spread < 1.35).all(), spread


@pytest.mark.slow
def test_lasting_errors_are_in_the_uncertainty() -> None:
    """A detector that is off in a way of each marker's own: the residuals show it."""
    rng = np.random.default_rng(5)
    sighter_map = {m.id: rng.normal(0, 0.2, (4, 2)) for m in HAND.markers}
    pulls, sigma = [], []
    for own in (True, False):
        true = misplaced(HAND, 6)
        sightings = []
        for sighting in seen(true, HAND, loop(40), sigma_px=0.1):
            corners = np.array(sighting.detections.corners_px)
            for i, marker_id in enumerate(sighting.detections.ids):
                x = corners[i, 1] - corners[i, 0]
                y = corners[i, 3] - corners[i, 0]
                axes = np.stack([x / np.linalg.norm(x), y / np.linalg.norm(y)])
                corners[i] += own * sighter_map[int(marker_id)] @ axes
            moved = Detections(sighting.detections.ids, corners)
            sightings.append(replace(sighting, detections=moved))
        found = survey(sightings, CAMERA, HAND, SurveyOptions(FIXED))
        sigmas = [[*m.shift_sigma_m, *m.turn_sigma_rad] for m in found.markers if not m.fixed]
        pulls.append(float(np.sqrt(((errors(found.refined, true) / sigmas) ** 2).mean())))
        sigma.append(found.bias_px)
    assert sigma[0] == pytest.approx(0.2, rel=0.35)
    assert sigma[1] < 0.04
    assert 0.5 < pulls[0] < 1.6


def test_wrong_corners() -> None:
    """One corner in twenty somewhere else, and one marker's id also on the robot."""
    true = misplaced(HAND, 7)
    clean = survey(seen(true, HAND, loop(40), sigma_px=0.2), CAMERA, HAND, SurveyOptions(FIXED))
    wrong = seen(true, HAND, loop(40), sigma_px=0.2, wrong=0.05)
    fixed_in_image = np.array([[600.0, 40.0], [640, 40], [640, 80], [600, 80]])
    for i in range(0, len(wrong), 4):
        found = wrong[i].detections
        corners = np.array(found.corners_px)
        corners[found.ids == 5] = fixed_in_image
        wrong[i] = replace(wrong[i], detections=Detections(found.ids, corners))
    robust = survey(wrong, CAMERA, HAND, SurveyOptions(FIXED))
    assert robust.rejected > 50
    assert rms_m(robust.refined, true) < 1.5 * rms_m(clean.refined, true) + 2e-4
    assert rms_m(robust.refined, true) < rms_m(HAND, true) / 5


def test_without_fix_the_priors_are_the_gauge() -> None:
    """The refined map as a whole is where the hand measurements are on average."""
    nobody = frozenset[int]()
    true = misplaced(HAND, 8, fixed=nobody)
    sightings = seen(true, HAND, loop(30), sigma_px=0.1, fixed=nobody)
    found = survey(sightings, CAMERA, HAND, SurveyOptions(loss="linear"))
    shift = np.array([marker.shift_m for marker in found.markers])
    # Where the whole map is costs nothing but priors: there their pulls cancel out.
    assert np.abs(shift.mean(axis=0)).max() < 1e-5
    off = errors(found.refined, true, nobody)[:, :3].mean(axis=0)
    assert np.linalg.norm(off) > 1e-3
    assert "on average" in survey_text(found, FrameCount())
    # A marker that was measured well holds the others.
    markers = tuple(
        Marker.from_pose(m.id, m.T_map_marker, m.size_m, 0.0001 if m.id == 3 else 0.05)
        for m in HAND.markers
    )
    well = replace(HAND, markers=markers)
    held = survey(seen(true, well, loop(30), fixed=nobody), CAMERA, well, SurveyOptions())
    by_id = {marker.id: marker for marker in held.markers}
    assert np.abs(by_id[3].shift_m).max() < 1e-4
    assert by_id[3].prior.std_m == 0.0001


def test_a_mistake_of_the_tape_measure() -> None:
    """One marker is 8 cm off: it is named, and the others stay where they are."""
    true = misplaced(HAND, 9)
    shifted = true.by_id[6]
    pose = Pose(shifted.T_map_marker.rotation, shifted.centre_m + np.array([0.08, 0, 0]))
    far = replace(
        true,
        markers=tuple(
            Marker.from_pose(m.id, pose, m.size_m) if m.id == 6 else m for m in true.markers
        ),
    )
    found = survey(seen(far, HAND, loop(30), sigma_px=0.2), CAMERA, HAND, SurveyOptions(FIXED))
    assert [marker.id for marker in found.markers if marker.implausible] == [6]
    assert rms_m(found.refined, far) < 3e-3
    assert any("measure again: 6" in line for line in warnings(found))
    assert not any("most of them" in line for line in warnings(found))
    # Off by more than was said nearly everywhere, it is not the tape measure.
    sure = tuple(replace(marker, prior=Prior(0.0005, 0.0005)) for marker in found.markers)
    assert any("most of them" in line for line in warnings(replace(found, markers=sure)))
    rows = survey_text(found, FrameCount()).splitlines()
    row = next(row for row in rows if row.split()[:1] == ["6"])
    assert "measure again" in row


def test_measuring_again_is_not_asked_for_by_chance() -> None:
    """Twenty markers measured as well as was said: one survey in a hundred may name one of them."""
    true = misplaced(HAND, 9)
    found = survey(seen(true, HAND, loop(12)), CAMERA, HAND, SurveyOptions(FIXED))
    marker = next(m for m in found.markers if not m.fixed)
    turn = np.zeros(3)
    moved = [replace(marker, shift_m=np.array([0.0, s, 0.0]), turn_rad=turn) for s in (0.035, 0.05)]
    assert [m.implausible for m in moved] == [False, True]
    chance = math.erfc(IMPLAUSIBLE_SIGMAS / math.sqrt(2))
    assert 1 - (1 - chance) ** (6 * 20) < 0.01


def test_a_marker_fixed_where_it_is_not() -> None:
    """Fixed markers that contradict each other are told of; which one is wrong nobody knows."""
    true = misplaced(HAND, 9)
    fixed = FIXED | {5}
    sightings = seen(true, HAND, loop(30), sigma_px=0.2, fixed=fixed)
    found = survey(sightings, CAMERA, HAND, SurveyOptions(fixed))
    assert found.contradicted
    assert set(found.contradicted) < fixed
    told = " / ".join(warnings(found))
    assert "fixed, but not where the images have it" in told
    assert "another size" not in told
    # The map hangs on all that it was told to, and none of them is left out in silence.
    by_id = {marker.id: marker for marker in found.markers}
    assert fixed <= set(by_id)
    assert all(by_id[i].seen > 10 for i in fixed)
    assert found.disowned == ()
    assert rms_m(found.refined, true, fixed) < rms_m(HAND, true, fixed)
    header = refined_yaml(found, {"a.mcap": "1", "map.yaml": "2"}).decode()
    assert f"; the images contradict {found.contradicted[0]}" in header


def test_what_is_fixed_and_no_better_than_the_rest_spoils_the_map() -> None:
    """Then it is better to fix nothing, as README and report say."""
    gains = []
    for seed in range(4):
        true = misplaced(HAND, 100 + seed, fixed=frozenset())
        before = rms_m(HAND, true, frozenset())
        for fixed in (frozenset[int](), FIXED):
            sightings = seen(true, HAND, loop(16), sigma_px=0.2, fixed=fixed)
            found = survey(sightings, CAMERA, HAND, SurveyOptions(fixed))
            gains.append(before / rms_m(found.refined, true, frozenset()))
    free, held = np.reshape(gains, (-1, 2)).T
    assert (free > held).all()
    assert free.min() > 1.8
    assert held.max() < 2.5
    told = survey_text(found, FrameCount())
    assert "fix what was measured much better than the rest, or nothing" in told


def test_a_marker_of_another_size() -> None:
    """Its corners fit nowhere: it is named as such, and does not bend the map."""
    true = misplaced(HAND, 13)
    big = replace(
        true,
        markers=tuple(
            Marker.from_pose(m.id, m.T_map_marker, 0.18) if m.id == 6 else m for m in true.markers
        ),
    )
    found = survey(seen(big, HAND, loop(30), sigma_px=0.2), CAMERA, HAND, SurveyOptions(FIXED))
    assert found.unseen == ()
    assert found.disowned == (6,)
    assert found.refined.by_id[6] is HAND.by_id[6]
    assert rms_m(found.refined, true, FIXED | {6}) < 3e-3
    assert any("size" in line and ": 6" in line for line in warnings(found))


def two_halls() -> tuple[MarkerMap, list[Pose]]:
    """Two groups of markers 20 m apart, nothing between them, and one marker nobody drives by."""
    near = worlds.ceiling(2, 3)
    far = [
        Marker.from_yaw(m.id + 10, m.centre_m + np.array([20, 0, 0]), 0.3 * m.id, "down", 0.15)
        for m in near.markers
    ]
    lonely = Marker.from_yaw(30, (0, 30, 2.5), 0, "down", 0.15, 0.02, ("store",))
    hall = MarkerMap("hall", near.dictionary, (*near.markers, *far, lonely))
    poses = [
        worlds.looking_up(x + 0.3 * np.cos(a), 0.3 * np.sin(a), 0.4, a)
        for x in (0, 20)
        for a in np.linspace(0, 6, 12)
    ]
    return hall, poses


def test_groups_that_nothing_ties_together() -> None:
    hall, poses = two_halls()
    fixed = frozenset({0, 30})
    true = misplaced(hall, 10, fixed=fixed)
    found = survey(seen(true, hall, poses, fixed=fixed), CAMERA, hall, SurveyOptions(fixed))
    assert found.groups == (tuple(range(6)), tuple(range(10, 16)))
    assert found.unseen == (30,)
    assert found.refined.by_id[30] is hall.by_id[30]
    told = " / ".join(warnings(found))
    assert "0, 1, 2, 3, 4, 5; 10, 11, 12, 13, 14, 15" in told
    assert "left as measured: 30" in told
    assert "nothing is tied to them: 30" in told
    # Tied to a fixed marker, or only to hand measurements: the uncertainty says which.
    sigma = {m.id: float(np.nan_to_num(m.shift_sigma_m).max()) for m in found.markers}
    assert max(sigma[i] for i in range(6)) < 1e-3
    assert min(sigma[i] for i in range(10, 16)) > 2e-3


def test_only_frames_that_say_something() -> None:
    true = misplaced(HAND, 11)
    sighter = Sighter(CAMERA, HAND, FIXED, RansacIterative())
    whole = worlds.corners(worlds.looking_up(), CAMERA, true)
    assert sighter(0, 0, None) is None
    assert sighter(0, 1, Detections.none()) is None
    assert sighter(0, 2, whole.select([3])) is None
    assert sighter(0, 3, whole.select(np.isin(whole.ids, sorted(FIXED)))) is None
    stranger = Detections(np.array([3, 500]), whole.corners_px[:2])
    assert sighter(0, 4, stranger) is None
    kept = sighter(0, 5, whole)
    assert kept is not None
    assert len(kept.detections) == len(whole)
    count = sighter.count
    assert (count.read, count.undecodable, count.few_markers) == (6, 1, 3)
    assert (count.only_fixed, count.without_pose, count.usable) == (1, 0, 1)


def test_nothing_to_survey() -> None:
    with pytest.raises(ValueError, match="two mapped markers, one of them not fixed, found none"):
        survey([], CAMERA, HAND, SurveyOptions(FIXED))
    with pytest.raises(ValueError, match="ids of the map to fix, found 99"):
        survey([], CAMERA, HAND, SurveyOptions(frozenset({99})))


def scaled(by: float) -> MarkerMap:
    """As if the tape measure were, across the ceiling."""
    markers = []
    for marker in HAND.markers:
        T = marker.T_map_marker
        pose = Pose(T.rotation, T.translation * [by, by, 1.0])
        markers.append(Marker.from_pose(marker.id, pose, marker.size_m))
    return replace(HAND, markers=tuple(markers))


def test_a_map_of_another_place_is_no_survey() -> None:
    """Each marker is somewhere, none where another one would have it."""
    order = np.random.default_rng(0).permutation(12)
    markers = zip(HAND.markers, order, strict=True)
    true = replace(
        HAND,
        markers=tuple(
            Marker.from_pose(m.id, HAND.markers[i].T_map_marker, m.size_m) for m, i in markers
        ),
    )
    good = seen(true, true, loop(12), fixed=frozenset())
    with pytest.raises(ValueError, match=r"expected corners that fit to 5 px, found .* place"):
        survey(good, CAMERA, HAND, SurveyOptions())


@pytest.mark.parametrize(("by", "outcome"), [(1.0, ""), (1.05, "warning"), (1.5, "error")])
def test_a_wrong_scale_shows_in_the_edges(by: float, outcome: str) -> None:
    """Nothing but the edges tells it, where nothing is fixed and the camera stays level."""
    hand, poses = scaled(by), [worlds.looking_up(0.1 * i, 0.0, 0.4, 0.3 * i) for i in range(-6, 7)]
    options = SurveyOptions(edges=EdgePrior(0.49, 0.1))
    sightings = seen(HAND, hand, poses, inset_px=0.49, sigma_px=0.3, fixed=frozenset())
    if outcome == "error":
        with pytest.raises(ValueError, match="px: are the markers' sizes and places of one scale"):
            survey(sightings, CAMERA, hand, options)
    else:
        told = warnings(survey(sightings, CAMERA, hand, options))
        assert any("by a few percent" in line for line in told) == (outcome == "warning"), told


@pytest.mark.parametrize(("fixed", "told"), [({0, 1}, True), ({5}, True), ({0, 11}, False)])
def test_what_is_fixed_should_be_far_apart(fixed: set[int], told: bool) -> None:
    ids = frozenset(fixed)
    found = survey(seen(HAND, HAND, loop(12), fixed=ids), CAMERA, HAND, SurveyOptions(ids))
    assert any("fix two that are far apart" in line for line in warnings(found)) == told


def test_keyframes_differ() -> None:
    """Of a drive that stands still for most of the time, the standing gets few frames."""
    standing = [worlds.looking_up(0.5, 0.0, 0.4, 0.0)] * 200
    sightings = seen(HAND, HAND, [*standing, *loop(40)])
    chosen = choose(sightings, HAND, 30)
    assert len(chosen) == 30 == len(set(chosen.tolist()))
    assert (np.diff(chosen) > 0).all()
    assert (chosen < 200).sum() <= 3
    np.testing.assert_array_equal(choose(sightings[:20], HAND, 30), np.arange(20))
    # Also where there are not so many different ones.
    assert len(choose(sightings[:200], HAND, 30)) == 30


def test_keyframes_show_every_marker() -> None:
    hall, poses = two_halls()
    sightings = seen(hall, hall, [*poses[:12]] * 20 + [poses[-1]], fixed=frozenset())
    last = len(sightings) - 1
    assert last in choose(sightings, hall, 10)


@pytest.mark.slow
def test_same_again() -> None:
    """Nothing is drawn by chance."""
    true = misplaced(HAND, 12)
    sightings = seen(true, HAND, loop(20), sigma_px=0.2)
    first, second = (
        survey(sightings, CAMERA, HAND, SurveyOptions(FIXED, max_frames=12)) for _ in range(2)
    )
    for a, b in zip(first.refined.markers, second.refined.markers, strict=True):
        np.testing.assert_array_equal(a.corners_m, b.corners_m)
    assert first.frames == 12


def test_refined_marker_is_a_square() -> None:
    """Also where four corners were measured, which then only start it."""
    bent = np.array(HAND.markers[5].corners_m)
    bent[2] += (0.002, 0.002, 0)
    markers = tuple(Marker.from_corners(5, bent) if m.id == 5 else m for m in HAND.markers)
    hand = replace(HAND, markers=markers)
    found: Survey = survey(seen(HAND, hand, loop(20)), CAMERA, hand, SurveyOptions(FIXED))
    marker = found.refined.by_id[5]
    square = marker.T_map_marker.apply(CORNER_SIGNS * marker.size_m / 2)
    np.testing.assert_allclose(marker.corners_m, square, rtol=0, atol=1e-12)
