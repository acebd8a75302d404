"""The comparison table: settings that differ, errors, and refusals."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from analysis.compare import as_text, compare
from recorder.errors import InputError
from replay.inputs import Overrides
from replay.run import ReplayOptions, replay
from replay.settings_file import load_settings
from tests import worlds


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("compare")
    log = worlds.small_log(folder / "a.mcap", 6)
    made = []
    for name, overrides in (("all", []), ("two", ["pose.max_markers=2"])):
        options = ReplayOptions(settings=load_settings(None, overrides), rrd=False, progress=False)
        replay(log, folder / name, name, options)
        made.append(folder / name)
    return made


def test_one_result_compares_its_trackers(results: list[Path]) -> None:
    table = compare(results[:1])
    assert table["tracker"].tolist() == ["fixes", "adaptive", "min", "max", "mean", "median"]
    assert "result" not in table
    assert "pose.max_markers" not in table
    assert table["variance.statistic"].tolist() == ["-", "-", "min", "max", "mean", "median"]
    assert (table["ok %"] == 100).all()
    assert table["exact rmse x cm"].iloc[0] < 0.5


def test_two_results_show_the_setting_that_differs(results: list[Path]) -> None:
    table = compare(results)
    by_result = table.groupby("result", sort=False)["pose.max_markers"].unique()
    assert {name: list(values) for name, values in by_result.items()} == {
        "all": ["-"],
        "two": ["2"],
    }
    text = as_text(table)
    assert "pose.max_markers" in text
    assert "detector.kind" not in text
    assert len(text.splitlines()) == 13


def test_results_of_different_logs_are_not_compared(results: list[Path], tmp_path: Path) -> None:
    other = worlds.small_log(tmp_path / "b.mcap", 5)
    replay(other, tmp_path / "other", "other", ReplayOptions(rrd=False, progress=False))
    with pytest.raises(InputError, match=r"a result of a\.mcap"):
        compare([results[0], tmp_path / "other"])


def test_one_result_twice_is_no_comparison(results: list[Path]) -> None:
    with pytest.raises(InputError, match="each result once"):
        compare([results[0], results[0]])


def test_another_map_is_a_difference(results: list[Path], tmp_path: Path) -> None:
    text = (results[0] / "map.yaml").read_text()
    (tmp_path / "other.yaml").write_text(text.replace("2.5]", "2.6]"))
    options = ReplayOptions(
        rrd=False, progress=False, overrides=Overrides(map=tmp_path / "other.yaml")
    )
    replay(results[0].parent / "a.mcap", tmp_path / "other", "other", options)
    table = compare([results[0], tmp_path / "other"])
    assert table["map.yaml"].nunique() == 2
    assert "camera.yaml" not in table


def test_a_folder_that_is_no_result(results: list[Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no summary\.json"):
        compare([results[0], tmp_path])


def test_results_of_one_name_are_told_apart(results: list[Path], tmp_path: Path) -> None:
    shutil.copytree(results[0], tmp_path / "copy")
    table = compare([results[0], tmp_path / "copy"])
    assert table["result"].nunique() == 2
