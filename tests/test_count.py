"""The study of the number of markers, against a plain loop over all subsets."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import pipeline.batch_pose
from analysis.analyze_cli import analyze
from analysis.static.count import _findings, count
from analysis.static.count_statistics import CountResult, knee, summarize
from analysis.static.subsets import SubsetFixes, SubsetOptions, layouts
from analysis.static.view import open_view
from analysis.study import Study, text, write_study
from pipeline.pose import RansacIterative
from recorder.errors import InputError
from tests.still_results import CAMERA, PLACE, noisy_frames, ring_map, still_result

MAP = ring_map(3, 3)
QUIET = SubsetOptions(progress=False)


def frame_of(study: Study, name: str) -> dict[int, dict[Any, Any]]:
    table = next(t for t in study.tables if t.name == name)
    return {int(row["markers"]): row for row in table.frame.to_dict("records")}


@pytest.fixture
def result(tmp_path: Path) -> Path:
    return still_result(tmp_path / "six", MAP, noisy_frames(MAP, 3))


def brute_force(frames: int = 1) -> dict[int, np.ndarray]:
    """(subsets, 2) x and y errors in cm by number of markers, from the paper's solver."""
    solver, found = RansacIterative(), {}
    for size in range(1, 7):
        errors = []
        for detections in noisy_frames(MAP, 3)[:frames]:
            for subset in combinations(range(6), size):
                fix = solver(detections.select(list(subset)), CAMERA, MAP, 0.0)
                assert fix.T_map_camera is not None
                errors.append(fix.T_map_camera.translation[:2] - PLACE.translation[:2])
        found[size] = 100.0 * np.array(errors)
    return found


def test_six_markers_against_brute_force(result: Path) -> None:
    options = SubsetOptions(max_markers=6, solver="opencv", progress=False)
    study = count(result, options)
    table, largest = frame_of(study, "count"), frame_of(study, "count_max")
    quantiles, variances = frame_of(study, "count_quantiles"), frame_of(study, "count_variance")
    for size, errors in brute_force().items():
        row = table[size]
        assert row["subsets"] == row["of"] == row["fixes"] == math.comb(6, size)
        assert row["rmse_x_cm"] == pytest.approx(np.sqrt(np.mean(errors[:, 0] ** 2)), rel=1e-6)
        assert row["bias_y_cm"] == pytest.approx(errors[:, 1].mean(), rel=1e-6)
        position = np.hypot(*errors.T)
        assert largest[size]["max_position_cm"] == pytest.approx(position.max(), rel=1e-6)
        q95 = np.quantile(np.abs(errors[:, 0]), 0.95)
        assert quantiles[size]["q95_x_cm"] == pytest.approx(q95, rel=1e-6)
        if size < 6:
            var = errors[:, 1].var()
            assert variances[size]["var_y_cm2"] == pytest.approx(var, rel=1e-6)
    assert np.isnan(variances[6]["var_y_cm2"])


@pytest.mark.parametrize("size", [1, 2, 4])
def test_intervals_hold_what_other_markers_give(size: int, tmp_path: Path) -> None:
    """A fix is the mean of what its markers say; each errs by its own constant."""
    marker_map = ring_map(6, 6)
    view = open_view(still_result(tmp_path / "r", marker_map, noisy_frames(marker_map, 2)))
    chosen = layouts(range(12), size, 10_000, 0)
    rng, trials = np.random.default_rng(size), 60
    held = {"rmse": 0.0, "bias": 0.0}
    true = {"rmse": np.sqrt(0.5**2 + 1.04 / size), "bias": 0.5}
    for _ in range(trials):
        own = 0.5 + rng.normal(size=(1, 12, 3)) + rng.normal(0, 0.2, (2, 12, 3))
        values = 0.01 * own[:, chosen.members].mean(axis=2)
        fixes = SubsetFixes(chosen, values, np.ones(values.shape[:2], dtype=bool))
        row = summarize(view, fixes, np.zeros((2, 3)), has_truth=True).row
        for name, value in true.items():
            for axis in "xy":
                low, high = row[f"{name}_{axis}_low_cm"], row[f"{name}_{axis}_high_cm"]
                held[name] += (low <= value <= high) / (2 * trials)
    assert held["rmse"] >= 0.85
    assert held["bias"] >= 0.90


def test_subsets_of_most_markers_have_no_interval(result: Path) -> None:
    study = count(result, SubsetOptions(max_markers=6, progress=False))
    found = frame_of(study, "count_rmse")
    for size, row in found.items():
        assert np.isfinite(row["rmse_x_low_cm"]) == (size <= 3)
        assert size > 3 or row["rmse_x_low_cm"] < row["rmse_x_cm"] < row["rmse_x_high_cm"]
    assert "No interval for subsets of 4, 5, 6 markers" in text(study)


def test_the_worst_and_best_subsets_by_name(result: Path) -> None:
    study = count(result, SubsetOptions(max_markers=2, solver="opencv", progress=False))
    extremes = next(t for t in study.tables if t.name == "count_extremes").frame
    pairs = list(combinations(range(6), 2))
    position = np.hypot(*brute_force()[2].T)
    two = extremes[extremes["markers"] == 2]
    worst, best = pairs[int(position.argmax())], pairs[int(position.argmin())]
    assert two.iloc[0]["worst"] == f"{worst[0]} {worst[1]}"
    assert two.iloc[0]["best"] == f"{best[0]} {best[1]}"
    assert two.iloc[0]["worst_cm"] == pytest.approx(position.max(), rel=1e-6)
    centres = [MAP.by_id[i].centre_m for i in worst]
    assert two.iloc[0]["worst_extent_m"] == pytest.approx(np.linalg.norm(centres[0] - centres[1]))
    assert list(two["rank"]) == list(range(1, 11))


def test_several_frames_pool_their_fixes(result: Path) -> None:
    options = SubsetOptions(max_markers=3, solver="opencv", n_frames=3, progress=False)
    row = frame_of(count(result, options), "count")[3]
    errors = brute_force(frames=3)[3]
    assert row["fixes"] == 60
    assert row["rmse_x_cm"] == pytest.approx(np.sqrt(np.mean(errors[:, 0] ** 2)), rel=1e-6)


def test_the_batch_agrees_on_many_markers(result: Path) -> None:
    batch, opencv = (
        frame_of(count(result, SubsetOptions(6, solver, progress=False)), "count")
        for solver in ("batch", "opencv")
    )
    for size in (4, 5, 6):
        assert batch[size]["rmse_x_cm"] == pytest.approx(opencv[size]["rmse_x_cm"], abs=0.02)


def test_a_second_run_goes_on_where_the_first_stopped(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "out"
    options = SubsetOptions(5, keep=kept, progress=False)
    first = text(count(result, options))
    files = sorted((kept / "subsets").glob("*.npz"))
    assert len(files) == 5
    files[0].unlink()
    files[1].write_bytes(files[1].read_bytes()[:100])
    solved = []
    solve = pipeline.batch_pose.solve_subsets

    def counting(*args: Any, **kwargs: Any) -> Any:
        solved.append(args[3].shape[1])
        return solve(*args, **kwargs)

    monkeypatch.setattr(pipeline.batch_pose, "solve_subsets", counting)
    assert text(count(result, options)) == first
    # The lost piece and the damaged one, no more; another solver's are not taken.
    assert len(solved) == 2
    count(result, SubsetOptions(5, "opencv", keep=kept, progress=False))
    assert len(list((kept / "subsets").glob("*.npz"))) == 10
    assert not list((kept / "subsets").glob("*.part"))


def test_a_sample_is_different_subsets_and_says_so(result: Path) -> None:
    study = count(result, SubsetOptions(sample=8, max_markers=3, progress=False))
    row = frame_of(study, "count")[3]
    assert (row["subsets"], row["of"]) == (8, 20)
    assert "8 of 20 with 3 markers" in text(study)
    assert "seed 0" in text(study)


@pytest.mark.parametrize(("n", "size", "limit"), [(8, 3, 20), (60, 6, 500), (5, 2, 10)])
def test_layouts_are_ascending_distinct_and_seeded(n: int, size: int, limit: int) -> None:
    drawn = layouts(range(n), size, limit, seed=3)
    members = drawn.members
    assert drawn.of == math.comb(n, size)
    assert len(members) == limit
    assert len(np.unique(members, axis=0)) == len(members)
    assert (np.diff(members, axis=1) > 0).all()
    assert members.min() >= 0
    assert members.max() < n
    assert np.array_equal(members, layouts(range(n), size, limit, seed=3).members)
    if limit < drawn.of:
        assert not np.array_equal(members, layouts(range(n), size, limit, seed=4).members)


def test_a_large_sample_favours_no_marker() -> None:
    members = layouts(range(60), 6, 5000, seed=0).members
    share = np.bincount(members.ravel(), minlength=60) / 5000
    # Each marker is in one subset of ten; 4σ of a binomial share of 5000.
    assert (np.abs(share - 0.1) < 4 * np.sqrt(0.1 * 0.9 / 5000)).all()


def test_the_knee_is_the_largest_relative_drop() -> None:
    found = knee([1, 2, 3, 4, 5], [100.0, 140.0, 120.0, 20.0, 2.5])
    assert found is not None
    assert (found.markers, found.before, found.after) == (5, 20.0, 2.5)
    assert knee([1, 2], [1.0, 2.0]) is None
    assert knee([1], [1.0]) is None


def test_without_truth_distances_from_the_pose_of_all(tmp_path: Path) -> None:
    folder = still_result(tmp_path / "bare", MAP, noisy_frames(MAP, 1), truth=None)
    study = count(folder, SubsetOptions(6, "opencv", progress=False))
    assert "count" not in [t.name for t in study.tables]
    largest = frame_of(study, "count_max")
    assert largest[6]["max_position_cm"] == pytest.approx(0.0, abs=1e-9)
    errors = brute_force()
    position = np.hypot(*(errors[2] - errors[6][0]).T)
    assert largest[2]["max_position_cm"] == pytest.approx(position.max(), rel=1e-6)


def test_fewer_markers_in_view_than_asked_for(tmp_path: Path) -> None:
    frame = noisy_frames(MAP, 1)[0].select([2])
    study = count(still_result(tmp_path / "one", MAP, [frame]), QUIET)
    assert list(frame_of(study, "count")) == [1]
    assert "No rows above 1 markers" in text(study)
    assert "No variance from fewer than two fixes: 1" in text(study)


def test_markers_that_come_and_go_are_left_out_and_named(tmp_path: Path) -> None:
    a, b = noisy_frames(MAP, 2)
    folder = still_result(tmp_path / "flicker", MAP, [a.select([0, 1, 2, 3]), b])
    study = count(folder, SubsetOptions(2, n_frames=2, progress=False))
    assert frame_of(study, "count")[2]["of"] == 6
    assert "left out: 4, 5" in text(study)


def test_no_marker_in_common_is_one_clear_line(tmp_path: Path) -> None:
    a, b = noisy_frames(MAP, 2)
    folder = still_result(tmp_path / "apart", MAP, [a.select([0]), b.select([1])])
    with pytest.raises(InputError, match="--frames"):
        count(folder, SubsetOptions(n_frames=2, progress=False))


def test_figures_are_written(result: Path, tmp_path: Path) -> None:
    study = count(result, SubsetOptions(max_markers=5, progress=False))
    names = {p.name for p in write_study(study, tmp_path / "out")}
    assert {"count_violins.svg", "count_ellipses.png", "count_largest.svg"} <= names


def test_on_the_command_line_long_lists_are_cut(result: Path) -> None:
    run = CliRunner().invoke(analyze(), ["count", str(result), "--max", "2", "--solver", "opencv"])
    assert run.exit_code == 0
    assert "Ranks above 3" in run.stdout
    run = CliRunner().invoke(analyze(), ["count", str(result), "--max", "2", "--json"])
    assert len(json.loads(run.stdout)["tables"]["count_extremes"]["rows"]) == 6 + 10


def test_memory_is_bounded_with_many_markers(tmp_path: Path) -> None:
    """Sizes of which there are millions of subsets, in a process of its own; poses are made up."""
    script = """
import sys
from pathlib import Path
import numpy as np
from analysis.static.count_statistics import summarize
from analysis.static.subsets import SubsetOptions, select_frames, solve_sizes
from analysis.static.view import open_view
from pipeline import batch_pose

def poses(seen, camera, marker_map, members, *, progress):
    m, rng = len(members), np.random.default_rng(0)
    flags = np.ones(m, bool)
    return batch_pose.BatchPoses(
        rng.normal(0, 0.01, (m, 3)), np.zeros((m, 4)), np.zeros(m), np.zeros(m), flags, flags
    )

batch_pose.solve_subsets = poses
view = open_view(Path(sys.argv[1]))
chosen = select_frames(view, 1)
fixes = solve_sizes(view, chosen, [6, 7], SubsetOptions(progress=False))
rows = [r.row for r in map(lambda f: summarize(view, f, chosen.truth, has_truth=True), fixes)]
assert len(chosen.ids) >= 50 and all(1e6 < r["subsets"] < r["of"] for r in rows), rows
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
    marker_map = ring_map(30, 30, radii_m=(0.45, 0.65))
    folder = still_result(tmp_path / "many", marker_map, noisy_frames(marker_map, 1))
    done = subprocess.run(
        [sys.executable, "-c", script, str(folder)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 1_000_000


def test_more_subsets_than_can_be_counted_is_one_clear_line(tmp_path: Path) -> None:
    marker_map = ring_map(40, 40, radii_m=(0.45, 0.65))
    folder = still_result(tmp_path / "many", marker_map, noisy_frames(marker_map, 1))
    with pytest.raises(
        InputError, match=r"fewer than 2\*\*63 subsets, found .* of 2\d of the .*--max"
    ):
        count(folder, SubsetOptions(40, sample=5, progress=False))


def test_a_sample_makes_no_knee_and_a_rising_rmse_is_said() -> None:
    """Errors that rise with the second marker; the third size only drawn."""

    def result(markers: int, of: int, largest: float, rmse: float) -> CountResult:
        row = {
            **{"subsets": 10, "of": of, "fixes": 10, "max_position_cm": largest},
            **{"rmse_position_cm": rmse, "bias_x_cm": 0.0, "bias_y_cm": 0.0},
        }
        extents = dict.fromkeys(("all", "worst", "best"), 1.0)
        drawn = np.zeros((1, 3))
        return CountResult(markers, row, drawn[0, :2], np.eye(2), drawn, pd.DataFrame(), extents)

    three = [result(1, 10, 5.0, 2.0), result(2, 10, 6.0, 3.0), result(3, 99, 1.0, 1.0)]
    said = _findings(three, has_truth=True)
    assert not any("falls" in sentence for sentence in said)
    assert "Of 3 markers random subsets were solved: larger errors may exist." in said
    assert "More markers are worse: the RMSE of the position rises at 2 (2.00 to 3.00 cm)." in said
