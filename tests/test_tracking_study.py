"""The tracking study: statistics worked out by hand, verdicts on filters whose truth is known."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from analysis.study import as_json, text, write_study
from analysis.style import TRACKER_COLOURS
from analysis.tracking.consistency import (
    lag1,
    lag1_band,
    log_likelihood,
    nees,
    nis_test,
)
from analysis.tracking.drive import Drive, collect_drive, load_drive, timeline, tracks_of
from analysis.tracking.figures import trajectory_figure
from analysis.tracking.pool import nees_in_band, pool
from analysis.tracking.sides import along, corner_to_corner
from analysis.tracking.statistics import (
    ACCURACY,
    ALL,
    CONSISTENCY,
    acceleration,
    drive_table,
)
from analysis.tracking.study import study_drives, study_tracking
from analysis.tracking_cli import tracking
from pipeline.detection import Detections
from pipeline.geometry import Array, Pose
from pipeline.localizer import FrameResult
from pipeline.pose import PoseFix
from pipeline.selection import MarkerLimit
from pipeline.tracker import ConstantVelocity
from pipeline.variance import StaticVariance, TableVariance, VarianceTable
from recorder.errors import InputError
from recorder.files.truth_file import TruthPath
from replay.result import Result, open_result
from replay.run import ReplayOptions, replay
from replay.viewer import style as viewer_style
from tests import worlds

RECTANGLE = TruthPath(np.array([[3.0, 2.0], [0.0, 2.0], [0.0, 0.0], [3.0, 0.0]]), True, 0.05)


def path_of(points: list[list[float]], *, closed: bool = False) -> TruthPath:
    return TruthPath(np.array(points), closed, 0.05)


def fix_at(xy_m: Array, n_markers: int) -> PoseFix:
    pose = Pose(np.eye(3), np.array([*xy_m, 0.3]))
    return PoseFix("ok", n_markers, tuple(range(n_markers)), n_markers, pose, 0.5, 0.5)


def drive_of(
    positions_m: Array,
    fixes_m: Array,
    n_markers: list[int],
    trackers: dict[str, ConstantVelocity],
    path: TruthPath | None = RECTANGLE,
    max_markers: tuple[MarkerLimit, ...] | None = None,
) -> Drive:
    """A drive at ten frames a second; no fix where `n_markers` is 0."""
    running = {name: settings.build() for name, settings in trackers.items()}
    results, exact = [], []
    for i, (true, seen, n) in enumerate(zip(positions_m, fixes_m, n_markers, strict=True)):
        stamp = worlds.START_NS + i * worlds.FRAME_NS
        fix = fix_at(seen, n) if n else PoseFix("no_markers")
        states = {name: tracker.step(stamp, fix) for name, tracker in running.items()}
        results.append(FrameResult(i, stamp, Detections.none(), fix, states))
        exact.append(Pose(np.eye(3), np.array([*true, 0.3])))
    return collect_drive("drive", results, exact, path, max_markers)


def around(step_m: float = 0.05) -> Array:
    """(200, 2) once around the rectangle: sides of 60, 40, 60, 40 frames, none at a corner."""
    corners = np.vstack([RECTANGLE.points_m, RECTANGLE.points_m[:1]])
    sides = [
        a
        + (b - a)
        * (np.arange(step_m / 2, np.linalg.norm(b - a), step_m) / np.linalg.norm(b - a))[:, None]
        for a, b in pairwise(corners)
    ]
    return np.vstack(sides)


def rows_of(drive: Drive) -> dict[tuple[str, str], dict[str, Any]]:
    """The table's rows by tracker and side."""
    return {
        (row["tracker"], row["side"]): {str(key): value for key, value in row.items()}
        for row in drive_table(drive).to_dict("records")
    }


class TestNumbersByHand:
    def test_nis_of_one_update_has_the_quantiles_of_an_exponential(self) -> None:
        test = nis_test(np.array([np.nan, 3.0]))
        # Chi-square with 2 degrees of freedom: P(q) = 1 - exp(-q / 2).
        assert (test.n, test.mean) == (1, 3.0)
        assert test.low == pytest.approx(-2 * np.log(0.975))
        assert test.high == pytest.approx(-2 * np.log(0.025))
        assert test.verdict == "consistent"

    def test_the_band_closes_around_2_with_the_number_of_updates(self) -> None:
        test = nis_test(np.full(5000, 2.2))
        # Mean 2 and variance 4 / n of a mean of n chi-squares of 2 degrees of freedom.
        assert test.high == pytest.approx(2 + 1.96 * 2 / np.sqrt(5000), abs=2e-3)
        assert test.low == pytest.approx(2 - 1.96 * 2 / np.sqrt(5000), abs=2e-3)
        assert test.verdict == "overconfident"
        assert nis_test(np.full(5000, 1.8)).verdict == "underconfident"
        with pytest.raises(ValueError, match="at least one update"):
            nis_test(np.array([np.nan]))

    def test_nees_is_the_sum_of_squares_over_variances(self) -> None:
        errors = np.array([[0.3, -0.4], [0.0, 0.1]])
        variances = np.array([[0.09, 0.04], [1.0, 0.01]])
        np.testing.assert_allclose(nees(errors, variances), [1 + 4, 1])

    def test_autocorrelation_at_lag_one(self) -> None:
        # Divided by σ: x 1, 1, -1 and y 1, 2, 2.
        innovations = np.array([[1.0, 2.0], [2.0, 4.0], [-2.0, 4.0]])
        variances = np.array([[1.0, 4.0], [4.0, 4.0], [4.0, 4.0]])
        x = (1 * 1 + 1 * -1) / np.sqrt(2 * 2)
        y = (1 * 2 + 2 * 2) / np.sqrt(5 * 8)
        np.testing.assert_allclose(lag1(innovations, variances), [x, y])
        assert lag1_band(100) == pytest.approx(0.196, abs=1e-4)

    def test_white_innovations_are_inside_the_band_and_a_bias_is_not(self) -> None:
        white = np.random.default_rng(3).normal(0, 1, (4000, 2))
        assert (np.abs(lag1(white, np.ones_like(white))) < lag1_band(3999)).all()
        assert (lag1(white + 0.5, np.ones_like(white)) > lag1_band(3999)).all()

    def test_log_likelihood_is_the_log_of_a_normal_density(self) -> None:
        values = log_likelihood(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([[1.0, 1.0]] * 2))
        np.testing.assert_allclose(values, [-np.log(2 * np.pi), -np.log(2 * np.pi) - 2])
        # A smaller unit of length makes densities smaller: it is a density, in m⁻².
        wide = log_likelihood(np.zeros((1, 2)), np.array([[4.0, 9.0]]))
        np.testing.assert_allclose(wide, [-np.log(2 * np.pi * 6)])

    def test_acceleration_of_a_parabola_is_exact_at_uneven_steps(self) -> None:
        time_s = np.array([0.0, 0.1, 0.4, 0.5, 1.5])
        position_m = np.column_stack([0.5 * 3.0 * time_s**2, 2.0 * time_s + 1])
        np.testing.assert_allclose(acceleration(time_s, position_m), [[3.0, 0.0]] * 3, atol=1e-12)

    def test_no_acceleration_where_no_time_passes(self) -> None:
        values = acceleration(np.array([0.0, 1.0, 1.0, 2.0, 3.0]), np.arange(10.0).reshape(5, 2))
        assert np.isnan(values[:2]).all()
        np.testing.assert_array_equal(values[2], [0.0, 0.0])


class TestSides:
    def test_a_rectangle_has_four_in_its_own_order(self) -> None:
        sides = corner_to_corner(RECTANGLE)
        assert [side.name for side in sides] == ["1", "2", "3", "4"]
        np.testing.assert_array_equal(sides[0].points_m, [[3, 2], [0, 2]])
        np.testing.assert_array_equal(sides[3].points_m, [[3, 0], [3, 2]])

    def test_points_along_a_side_and_shallow_turns_make_no_corner(self) -> None:
        dense = path_of([[0, 0], [1, 0], [2, 0.1], [3, 0], [3, 2]])
        assert [len(side.points_m) for side in corner_to_corner(dense)] == [4, 2]

    def test_a_closed_path_may_start_in_the_middle_of_a_side(self) -> None:
        middle = path_of([[1, 0], [3, 0], [3, 2], [0, 2], [0, 0]], closed=True)
        sides = corner_to_corner(middle)
        assert len(sides) == 4
        np.testing.assert_array_equal(sides[0].points_m, [[0, 0], [1, 0], [3, 0]])

    @pytest.mark.parametrize("closed", [True, False])
    def test_a_point_given_twice_is_one(self, closed: bool) -> None:
        points = [[0.0, 0.0], [3.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 0.0]]
        assert len(corner_to_corner(path_of(points, closed=closed))) == 3

    def test_frames_go_to_their_side_also_with_noise_at_the_corners(self) -> None:
        true = np.repeat([0, 1, 2, 3], [60, 40, 60, 40])
        noise = np.random.default_rng(1).normal(0, 0.05, (200, 2))
        found = along(corner_to_corner(RECTANGLE), around() + noise)
        # One run on each side; where it ends may be off by what the noise hides.
        assert np.flatnonzero(np.diff(found)).size == 3
        assert (found != true).sum() <= 9

    def test_on_a_corner_the_side_that_begins_has_the_frame(self) -> None:
        corners = [*RECTANGLE.points_m, RECTANGLE.points_m[0]]
        ways = [np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(corners)]
        found = along(corner_to_corner(RECTANGLE), np.concatenate(ways))
        assert (np.flatnonzero(np.diff(found)) + 1).tolist() == [20, 40, 60]

    def test_an_outlier_and_an_unknown_position_do_not_change_the_side(self) -> None:
        positions = around()
        positions[30] = [1.5, 0.1]
        positions[120:125] = np.nan
        np.testing.assert_array_equal(
            along(corner_to_corner(RECTANGLE), positions)[[29, 30, 31, 119, 122, 126]],
            [0, 0, 0, 2, 2, 2],
        )

    def test_limits_in_force_name_the_sides(self) -> None:
        limits = tuple(
            MarkerLimit(until_s=until_s, n=n) for until_s, n in ((6.0, 1), (10.0, 3), (None, None))
        )
        drive = drive_of(around(), around(), [1] * 60 + [3] * 40 + [6] * 100, ADAPTIVE, RECTANGLE)
        names = [side.name for side in timeline(drive).sides]
        assert names == ["1", "2", "3", "4"]
        drive = Drive(**{**vars(drive), "max_markers": limits})
        names = [side.name for side in timeline(drive).sides]
        assert names == ["1 (max 1)", "2 (max 3)", "3 (all)", "4 (all)"]
        # A replay that began later has its limits at the same times of the log.
        drive = Drive(**{**vars(drive), "from_s": 4.5})
        assert timeline(drive).sides[0].name == "1 (max 3)"


ADAPTIVE = {"adaptive": ConstantVelocity(variance=TableVariance())}


def honest(r_scale: float) -> ConstantVelocity:
    table = VarianceTable(cm2=((9.0, 4.0),))
    return ConstantVelocity(
        accel_std=0.2, r_scale=r_scale, variance=StaticVariance(statistic="mean", table=table)
    )


@pytest.fixture(scope="module")
def known_drive() -> Drive:
    """Motion and fixes drawn from the model of the tracker `true`; the others believe R wrongly."""
    trackers = {"true": honest(1.0), "tenth": honest(0.1), "tenfold": honest(10.0)}
    return drawn_drive(5, 1500, trackers)


def drawn_drive(
    seed: int, count: int, trackers: dict[str, ConstantVelocity], beside_m: float = 0.0
) -> Drive:
    """Motion with 0.2 m/s² of white acceleration, fixes of 3 and 2 cm, all as far beside it."""
    rng, dt = np.random.default_rng(seed), 0.1
    positions = np.zeros((count, 2))
    position, velocity = np.zeros(2), np.zeros(2)
    for i in range(1, count):
        accel = rng.normal(0, 0.2, 2)
        position = position + dt * velocity + dt**2 / 2 * accel
        velocity = velocity + dt * accel
        positions[i] = position
    fixes = positions + rng.normal(0, [0.03, 0.02], (count, 2)) + [0.0, beside_m]
    return drive_of(positions, fixes, [4] * count, trackers, path=None)


def test_a_true_model_is_consistent_and_r_wrong_by_ten_is_not(known_drive: Drive) -> None:
    rows = rows_of(known_drive)
    true, tenth, tenfold = (rows[name, ALL] for name in ("true", "tenth", "tenfold"))
    assert true["verdict"] == "consistent"
    assert tenth["verdict"] == "overconfident"
    assert tenfold["verdict"] == "underconfident"
    assert true["nees_mean"] == pytest.approx(2.0, abs=0.35)
    assert tenth["nees_mean"] > 3.5
    assert max(abs(true["lag1_x"]), abs(true["lag1_y"])) < true["lag1_band"]
    # What the filter says of the data is most likely where its model is theirs.
    assert true["log_likelihood"] > max(tenth["log_likelihood"], tenfold["log_likelihood"])
    sentences = " ".join(study_drives([known_drive]).findings)
    assert "tenth is overconfident about its fixes: mean NIS" in sentences
    assert "tenfold is underconfident" in sentences


def test_an_error_that_all_fixes_share_is_seen_by_the_exact_truth_only() -> None:
    """Fixes 6 cm beside the truth throughout: white innovations, a wrong position."""
    drive = drawn_drive(5, 1500, {"true": honest(1.0)}, beside_m=0.06)
    row = rows_of(drive)["true", ALL]
    assert row["verdict"] == "consistent"
    assert row["nees_mean"] > 10.0
    (said,) = (s for s in study_drives([drive]).findings if s.startswith("true is"))
    assert "consistent about its fixes" in said
    assert "About its position it is overconfident" in said


def test_repeats_pooled_know_which_covariance_is_true() -> None:
    """Bar-Shalom's N-run test: of the true filter 95 % of the moments are in the band."""
    trackers = {"true": honest(1.0), "tenth": honest(0.1)}
    drives = [drawn_drive(seed, 300, trackers) for seed in range(20)]
    tables = [drive_table(drive) for drive in drives]
    pooled, one = pool(tables), [rows_of(drive)["true", ALL] for drive in drives]
    rows: dict[str, Any] = {str(r["tracker"]): r for r in pooled.to_dict("records")}
    true, tenth = rows["true"], rows["tenth"]
    assert true["verdict"] == "consistent"
    assert tenth["verdict"] == "overconfident"
    assert true["updates"] == sum(row["updates"] for row in one)
    # Twenty repeats know the mean √20 times better.
    width = one[0]["nis_high"] - one[0]["nis_low"]
    assert true["nis_high"] - true["nis_low"] == pytest.approx(width / 20**0.5, rel=0.02)
    rmse_cm = [row["rmse_position_cm"] for row in one]
    assert true["rmse_position_cm"] == pytest.approx(np.sqrt(np.mean(np.square(rmse_cm))))
    assert np.isnan(true["path_max_cm"])
    shares = {}
    for n, name in enumerate(trackers):
        repeats = []
        for drive in drives:
            exact_m, track = timeline(drive).exact_m, tracks_of(drive)[n]
            assert exact_m is not None
            repeats.append(nees(track.position_m - exact_m, track.variance_m2))
        shares[name] = nees_in_band(repeats)
    assert shares["true"] == pytest.approx(0.95, abs=0.05)
    assert shares["tenth"] < 0.3


def test_only_repeats_of_one_drive_can_be_pooled(known_drive: Drive) -> None:
    table = drive_table(known_drive)
    with pytest.raises(ValueError, match="repeats of one drive"):
        pool([table, table[table["tracker"] != "tenth"]])


def test_the_place_of_overconfidence_is_named() -> None:
    """σ 20 cm on the first side, 1 cm elsewhere; `sure` believes in 1 cm everywhere."""
    rng = np.random.default_rng(2)
    sigma = np.repeat([0.2, 0.01], [60, 140])[:, None]
    fixes = around() + sigma * rng.normal(0, 1, (200, 2))
    sure = VarianceTable(cm2=((1.0, 1.0),))
    right = VarianceTable(cm2=((400.0, 400.0), (1.0, 1.0)))
    trackers = {
        "sure": ConstantVelocity(accel_std=1.0, r_scale=1.0, variance=TableVariance(table=sure)),
        "right": ConstantVelocity(accel_std=1.0, r_scale=1.0, variance=TableVariance(table=right)),
    }
    drive = drive_of(around(), fixes, [1] * 60 + [5] * 140, trackers)
    rows = rows_of(drive)
    assert rows["sure", "1"]["verdict"] == "overconfident"
    assert rows["right", "1"]["verdict"] != "overconfident"
    assert rows["fixes", "1"]["markers"] == 1
    assert rows["fixes", "2"]["markers"] == 5
    sentence = next(s for s in study_drives([drive]).findings if s.startswith("sure is"))
    assert re.search("overconfident on sides? 1: ", sentence)
    # The figure of one side is of the one with the fewest markers.
    zoom = next(f for f in study_drives([drive]).figures if f.name == "tracking_zoom")
    assert "Side 1" in zoom.title


def test_accuracy_by_hand() -> None:
    """A fix 6 cm beside the path on the first side, on it elsewhere; a tracker that follows."""
    offset = np.repeat([[0.0, 0.06], [0.0, 0.0]], [60, 140], axis=0)
    follower = {"follower": ConstantVelocity(accel_std=1e4, r_scale=1e-6, variance=TableVariance())}
    drive = drive_of(around(), around() + offset, [4] * 200, follower)
    rows = rows_of(drive)
    for name in ("fixes", "follower"):
        row = rows[name, "1"]
        assert row["frames"] == 60
        assert row["rmse_x_cm"] == pytest.approx(0.0, abs=1e-3)
        assert row["rmse_y_cm"] == pytest.approx(6.0, abs=1e-3)
        assert row["path_rms_cm"] == pytest.approx(6.0, abs=1e-3)
        assert row["in_band_percent"] == 0.0
        assert rows[name, "3"]["in_band_percent"] == 100.0
        assert rows[name, ALL]["in_band_percent"] == pytest.approx(70.0)
        rmse_cm = rows[name, ALL]["rmse_position_cm"]
        assert rmse_cm == pytest.approx(6.0 * np.sqrt(0.3), abs=1e-3)


def test_smoothness_is_the_rms_of_the_real_acceleration() -> None:
    """Constant acceleration of 0.5 m/s² seen without noise, frames lost on the way."""
    time_s = np.arange(40) * 0.1
    positions = np.column_stack([0.25 * time_s**2, np.zeros(40)])
    n_markers = [0 if i in (7, 8, 20) else 3 for i in range(40)]
    drive = drive_of(positions, positions, n_markers, ADAPTIVE, path=None)
    fixes = rows_of(drive)["fixes", ALL]
    assert fixes["frames"] == 37
    assert fixes["accel_rms_cmps2"] == pytest.approx(50.0)


def test_too_few_updates_leave_cells_empty_and_are_named() -> None:
    n_markers = [4] * 60 + [0] * 35 + [4] * 105
    drive = drive_of(around(), around(), n_markers, ADAPTIVE)
    row = rows_of(drive)["adaptive", "2"]
    assert row["updates"] == 5
    assert all(np.isnan(row[c]) for c in ("nis_mean", "nis_low", "log_likelihood", "lag1_x"))
    assert row["verdict"] == ""
    # It went on predicting: its positions have errors.
    assert row["rmse_x_cm"] > 0
    study = study_drives([drive])
    notes = [note for table in study.tables for note in table.notes]
    assert any("side 2 has fewer than 10 innovations (adaptive 5)" in note for note in notes)


def test_without_any_fix_there_are_no_numbers() -> None:
    drive = drive_of(around(), around(), [0] * 200, ADAPTIVE)
    study = study_drives([drive])
    table = drive_table(drive)
    assert (table["frames"] == 0).all()
    assert table[["rmse_x_cm", "path_rms_cm", "nis_mean", "accel_rms_cmps2"]].isna().all(axis=None)
    assert study.findings == ()
    assert text(study)


def test_without_exact_truth_rmse_and_nees_are_absent_and_sides_come_from_the_tracks() -> None:
    drive = drive_of(around(), around(), [4] * 200, ADAPTIVE)
    blind = Drive(**{**vars(drive), "truth": None})
    study = study_drives([blind])
    for table in study.tables:
        assert not {"rmse_x_cm", "rmse_position_cm", "nees_mean"} & set(table.frame.columns)
    assert any("path_rms_cm" in table.frame for table in study.tables)
    assert any("trackers' median" in note for table in study.tables for note in table.notes)
    true, guessed = timeline(drive).side, timeline(blind).side
    assert (true != guessed).mean() < 0.05


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Result]:
    folder = tmp_path_factory.mktemp("drives")
    opened = []
    for name, exact in (("exact", True), ("blind", False)):
        log = worlds.small_log(folder / f"{name}.mcap", 16, exact=exact)
        replay(log, folder / name, name, ReplayOptions(rrd=False, progress=False))
        opened.append(open_result(folder / name))
    return opened[0], opened[1]


def test_the_table_of_a_result_has_the_errors_of_its_summary(
    results: tuple[Result, Result],
) -> None:
    result = results[0]
    table = drive_table(load_drive(result))
    assert list(table.columns) == ["tracker", "side", "markers", *ACCURACY, *CONSISTENCY]
    assert set(table["side"]) == {ALL}
    for row in table.to_dict("records"):
        exact = result.summary["errors"]["exact"][row["tracker"]]
        path = result.summary["errors"]["path"][row["tracker"]]
        assert row["rmse_x_cm"] == pytest.approx(100 * exact["x_m"]["rmse"])
        assert row["rmse_position_cm"] == pytest.approx(100 * exact["position_m"]["rmse"])
        assert row["path_max_cm"] == pytest.approx(100 * path["max_m"])
        assert row["in_band_percent"] == pytest.approx(100 * path["share_in_band"])


def test_several_results_are_told_apart(results: tuple[Result, Result]) -> None:
    study = study_tracking(results)
    for table in study.tables:
        assert table.frame["result"].unique().tolist() == ["exact", "blind"]
    rows = study.tables[0].frame.set_index(["result", "tracker"])["rmse_x_cm"]
    assert rows["exact"].notna().all()
    assert rows["blind"].isna().all()
    names = [figure.name for figure in study.figures]
    assert len(set(names)) == len(names)
    twice = study_tracking([results[0], results[0]])
    assert twice.tables[0].frame["result"].unique().tolist() == [str(results[0].folder)]
    json.dumps(as_json(study), allow_nan=False)


def test_files_are_the_same_each_time(results: tuple[Result, Result], tmp_path: Path) -> None:
    made = [write_study(study_tracking(results[:1]), tmp_path / name) for name in "ab"]
    assert {path.suffix for path in made[0]} == {".csv", ".tex", ".svg", ".png"}
    for a, b in zip(*made, strict=True):
        assert a.read_bytes() == b.read_bytes(), a.name
    read = pd.read_csv(tmp_path / "a" / "tracking_accuracy.csv")
    pd.testing.assert_frame_equal(read, study_tracking(results[:1]).tables[0].frame)


def test_trackers_look_as_in_the_viewer() -> None:
    assert {
        name: tuple(bytes.fromhex(colour[1:])) for name, colour in TRACKER_COLOURS.items()
    } == viewer_style.TRACKER_COLOURS


def test_fixes_outside_of_the_figure_are_counted() -> None:
    fixes = around()
    fixes[[10, 20, 30]] += [0.0, 5.0]
    drive = drive_of(around(), fixes, [4] * 200, ADAPTIVE)
    figure, outside = trajectory_figure(drive)
    assert isinstance(figure, matplotlib.figure.Figure)
    assert outside == 3
    assert any("3 fixes are further out" in f.caption for f in study_drives([drive]).figures)


def test_the_verb_prints_writes_and_refuses(results: tuple[Result, Result], tmp_path: Path) -> None:
    folder = str(results[0].folder)
    done = CliRunner().invoke(tracking(), [folder, "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "Consistency over the whole drive" in done.output
    assert (tmp_path / "out" / "tracking_trajectory.svg").exists()
    done = CliRunner().invoke(tracking(), [folder, "--json"])
    tables = json.loads(done.stdout)["tables"]
    assert [row["tracker"] for row in tables["tracking_accuracy"]["rows"]][:2] == [
        "fixes",
        "adaptive",
    ]
    done = CliRunner().invoke(tracking(), [str(tmp_path)])
    assert isinstance(done.exception, InputError)
    assert CliRunner().invoke(tracking(), []).exit_code == 2
