"""The placement study on detections whose errors are known."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.container import ErrorbarContainer

from analysis.analyze_cli import analyze
from analysis.static.alone import solve_each
from analysis.static.groups import group
from analysis.static.placement import PlacementOptions, placement
from analysis.static.statistics import Bootstrap
from analysis.static.view import MovedError, open_view
from analysis.study import Study, StudyTable, as_json, latex, text, write_study
from pipeline.detection import Detections
from pipeline.geometry import Pose
from recorder.errors import InputError
from replay.run import ReplayOptions, replay
from tests import worlds
from tests.still_results import PLACE, noisy_frames, ring_map, shifted, still_result

FAST = PlacementOptions(Bootstrap(resamples=100))


def rows(study: Study, name: str) -> dict[str, dict[Any, Any]]:
    table = next(t for t in study.tables if t.name == name)
    key = "group" if "group" in table.frame else "ring"
    return {row[key]: row for row in table.frame.to_dict("records")}


@pytest.fixture
def known(tmp_path: Path) -> Path:
    """Inner markers off by 30 and 10 cm in x, outer ones by ∓1 cm in y; two equal frames."""
    marker_map = ring_map()
    shift = {0: (0.30, 0), 1: (0.10, 0), 2: (0.30, 0), 3: (0.10, 0)}
    shift |= {i: (0.0, 0.01 * (-1) ** i) for i in range(4, 8)}
    detections = shifted(marker_map, shift)
    return still_result(tmp_path / "known", marker_map, [detections, detections])


def test_errors_come_out_as_they_were_put_in(known: Path) -> None:
    study = placement([known], FAST)
    found = rows(study, "placement")
    assert list(found) == [
        *("all", "90° (inner)", "90° (outer)", "45° (inner)", "45° (outer)"),
        *("inner", "outer", "90°", "45°"),
    ]
    inner = found["inner"]
    assert inner["rmse_x_cm"] == pytest.approx(np.sqrt((900 + 100) / 2), abs=5e-3)
    assert inner["bias_x_cm"] == pytest.approx(20.0, abs=5e-3)
    assert inner["rmse_y_cm"] == pytest.approx(0.0, abs=5e-3)
    assert found["outer"]["rmse_y_cm"] == pytest.approx(1.0, abs=5e-3)
    assert found["outer"]["bias_y_cm"] == pytest.approx(0.0, abs=5e-3)
    assert found["90° (inner)"]["bias_x_cm"] == pytest.approx(30.0, abs=5e-3)
    assert rows(study, "placement_std")["inner"]["std_x_cm"] == pytest.approx(10.0, abs=5e-3)
    assert rows(study, "placement_max")["inner"]["max_x_cm"] == pytest.approx(30.0, abs=5e-3)
    assert found["all"]["rmse_yaw_deg"] == pytest.approx(0.0, abs=5e-3)
    assert found["all"]["fixes"] == 16


def test_the_share_of_large_errors(known: Path) -> None:
    found = rows(placement([known], FAST), "placement_share")
    assert found["inner"]["markers_above_pct"] == 50.0
    assert found["inner"]["fixes_above_pct"] == 50.0
    assert found["outer"]["markers_above_pct"] == 0.0
    assert 0 < found["inner"]["markers_low_pct"] < 50 < found["inner"]["markers_high_pct"] < 100


def test_no_bar_where_there_is_no_interval(tmp_path: Path) -> None:
    marker_map = ring_map(2, 5)
    folder = still_result(tmp_path / "few", marker_map, noisy_frames(marker_map, 3))
    study = placement([folder], FAST)
    found = rows(study, "placement_share")
    assert np.isnan(found["inner"]["fixes_low_pct"])
    # No fix of the outer markers is far off: that it never happens is not known for certain.
    assert found["outer"]["fixes_above_pct"] == found["outer"]["fixes_low_pct"] == 0.0
    assert found["outer"]["fixes_high_pct"] == found["outer"]["markers_high_pct"] > 20.0
    figure = next(f for f in study.figures if f.name == "placement_share").figure
    bars = [bar for bar in figure.axes[1].containers if isinstance(bar, ErrorbarContainer)]
    assert [len(bar[2][0].get_segments()) for bar in bars] == [0, 1]


def test_heights_side_by_side_nearest_first(known: Path, tmp_path: Path) -> None:
    marker_map = ring_map()
    near = Pose(PLACE.rotation, PLACE.translation + np.array([0, 0, 0.5]))
    frames = [shifted(marker_map, {})] * 2
    other = still_result(tmp_path / "near", marker_map, frames, places=[near, near])
    study = placement([known, other], FAST)
    heights = list(dict.fromkeys(study.tables[0].frame["height_m"]))
    assert heights == ["1.500", "2.000"]


def test_two_results_at_one_height_are_told_apart(known: Path, tmp_path: Path) -> None:
    marker_map = ring_map()
    again = still_result(tmp_path / "again", marker_map, noisy_frames(marker_map, 2))
    study = placement([known, again], FAST)
    assert study.tables[0].frame["height_m"].nunique() == 2


def test_groups_by_distance_without_tags() -> None:
    marker_map = ring_map(3, 6, tags=False)
    distance = {i: (10.0 if i < 3 else 100.0 + i) for i in range(9)}
    found = group(marker_map, range(9), distance)
    assert not found.by_tags
    assert [g.name for g in found.rings] == ["near the centre", "halfway", "far from the centre"]
    assert found.rings[0].ids == (0, 1, 2)
    assert [g.name for g in found.rows] == ["all", *(g.name for g in found.rings)]


def test_without_truth_only_the_spread(tmp_path: Path) -> None:
    marker_map = ring_map()
    frames = noisy_frames(marker_map, 6)
    bare = still_result(tmp_path / "bare", marker_map, frames, truth=None)
    study = placement([bare], FAST)
    assert [t.name for t in study.tables] == ["placement_std"]
    assert "no truth" in text(study)
    with_truth = placement([still_result(tmp_path / "exact", marker_map, frames)], FAST)
    # The same fixes scatter the same, with or without a truth.
    for axis in ("x_cm", "y_cm", "yaw_deg"):
        column = f"std_{axis}"
        assert rows(study, "placement_std")["all"][column] == pytest.approx(
            rows(with_truth, "placement_std")["all"][column]
        )


def test_a_measured_truth_without_heading_leaves_yaw_empty(tmp_path: Path) -> None:
    marker_map = ring_map()
    folder = still_result(
        tmp_path / "measured", marker_map, noisy_frames(marker_map, 3), truth="measured"
    )
    study = placement([folder], FAST)
    assert "measured truth" in text(study)
    row = rows(study, "placement")["all"]
    assert row["rmse_x_cm"] > 0
    assert np.isnan(row["rmse_yaw_deg"])


def test_too_few_markers_are_named_and_left_empty(tmp_path: Path) -> None:
    marker_map = ring_map(2, 4)
    study = placement(
        [still_result(tmp_path / "few", marker_map, noisy_frames(marker_map, 3))], FAST
    )
    table = next(t for t in study.tables if t.name == "placement_rmse")
    row = rows(study, "placement_rmse")["inner"]
    assert row["rmse_x_cm"] > 0
    assert np.isnan(row["rmse_x_low_cm"])
    assert any("fewer than 4 markers" in note and "inner" in note for note in table.notes)
    assert as_json(study)["tables"]["placement_rmse"]["rows"][1]["rmse_x_low_cm"] is None


def test_one_marker_one_frame(tmp_path: Path) -> None:
    marker_map = ring_map()
    frame = noisy_frames(marker_map, 1)[0].select([3])
    study = placement([still_result(tmp_path / "one", marker_map, [frame])], FAST)
    row = rows(study, "placement_std")["all"]
    assert row["markers"] == row["fixes"] == 1
    assert np.isnan(row["std_x_cm"])
    assert rows(study, "placement")["all"]["rmse_x_cm"] >= 0


def test_unknown_and_doubled_markers_are_left_out(tmp_path: Path) -> None:
    marker_map = ring_map()
    seen = noisy_frames(marker_map, 1)[0]
    ids = np.array([*seen.ids, 77, 5])
    frame = Detections(ids, np.concatenate([seen.corners_px, seen.corners_px[:2]]))
    view = open_view(still_result(tmp_path / "odd", marker_map, [frame]))
    assert view.ids == (0, 1, 2, 3, 4, 6, 7)
    assert np.isfinite(solve_each(view, 1).values).all()


def test_bad_input_is_one_clear_line(tmp_path: Path) -> None:
    marker_map = ring_map()
    frames = noisy_frames(marker_map, 3)
    moved = [Pose(PLACE.rotation, PLACE.translation + np.array([0.1 * i, 0, 0])) for i in range(3)]
    cases = {
        "moved": still_result(tmp_path / "moved", marker_map, frames, places=moved),
        "detections": still_result(tmp_path / "dark", marker_map, [Detections.none()] * 2),
        "arucolog replay": tmp_path,
    }
    for word, folder in cases.items():
        with pytest.raises(InputError) as caught:
            placement([folder], FAST)
        assert word in str(caught.value)
        assert "\n" not in str(caught.value)


def test_the_same_study_gives_the_same_files(known: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        write_study(placement([known], FAST), folder)
    names = sorted(p.name for p in first.iterdir())
    assert {"placement.csv", "placement.tex", "placement_xy.svg", "placement_share.png"} <= set(
        names
    )
    for name in names:
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


def test_on_the_command_line(known: Path, tmp_path: Path) -> None:
    run = CliRunner().invoke(analyze(), ["placement", str(known), "-o", str(tmp_path / "out")])
    assert run.exit_code == 0
    assert "90° (inner)" in run.stdout
    assert (tmp_path / "out" / "placement_rmse.csv").exists()
    run = CliRunner().invoke(analyze(), ["placement", str(known), "--json"])
    assert json.loads(run.stdout)["tables"]["placement"]["rows"][0]["group"] == "all"
    for verb in ("placement", "count", "variance", "tracking"):
        run = CliRunner().invoke(analyze(), [verb, "--help"])
        assert run.exit_code == 0
        assert "Example:" in run.stdout


def _replayed(folder: Path, *, moving: bool = True) -> Path:
    log = worlds.small_log(folder / "a.mcap", 12, exact=False, moving=moving)
    replay(log, folder / "r", "r", ReplayOptions(rrd=False, progress=False))
    return folder / "r"


def test_a_drive_with_one_measured_stand_is_no_still_camera(tmp_path: Path) -> None:
    """The truth stands still; the camera does not."""
    with pytest.raises(MovedError, match="stands still"):
        open_view(_replayed(tmp_path))


def test_a_truth_of_other_frames_is_no_truth(tmp_path: Path) -> None:
    folder = _replayed(tmp_path, moving=False)
    truth = pd.read_parquet(folder / "truth.parquet")
    truth["frame_index"] += 1000
    truth.to_parquet(folder / "truth.parquet")
    view = open_view(folder)
    assert view.truth_kind is None
    assert placement([folder]).tables


def test_captions_are_latex() -> None:
    frame = pd.DataFrame({"q95_cm": [1.0]})
    assert r"\caption{The 95 \% \& more}" in latex(StudyTable("t", "The 95 % & more", frame))
