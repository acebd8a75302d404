"""Measured variances: right numbers, and a file that settings read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from analysis.analyze_cli import analyze
from analysis.static.subsets import Layouts, SubsetFixes, SubsetOptions
from analysis.static.variance_measure import measure
from analysis.static.variance_table import variance
from analysis.study import text
from pipeline.batch_pose import subsets
from pipeline.localizer import PipelineSettings
from pipeline.variance import StaticVariance, TableVariance
from recorder.errors import InputError
from replay.settings_file import load_settings, settings_yaml
from replay.variance_file import read_table
from tests.still_results import noisy_frames, ring_map, still_result

MAP = ring_map(3, 3)
OPTIONS = SubsetOptions(max_markers=4, n_frames=None, progress=False)


def fixes(values_m: np.ndarray, n_markers: int) -> SubsetFixes:
    """One marker each, (frames, markers, 2) fixes."""
    shape = values_m.shape[:2]
    values = np.concatenate([values_m, np.zeros((*shape, 1))], axis=2)
    layouts = Layouts(tuple(range(n_markers)), np.arange(n_markers)[:, None], n_markers)
    return SubsetFixes(layouts, values, np.ones(shape, dtype=bool))


def test_variance_about_the_mean_by_hand() -> None:
    x = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]] * 2) / 100.0
    found = measure(fixes(np.stack([x + 7.0, 3 * x - 1.0], axis=2), 6))
    # 1 to 6 about 3.5: 35/12. Median deviation: (0.5, 0.5, 1.5, 1.5, 2.5, 2.5) -> 1.5.
    assert found.cm2 == pytest.approx([35 / 12, 9 * 35 / 12])
    assert found.robust_cm2 == pytest.approx([(1.482602218505602 * 1.5) ** 2] * np.array([1, 9]))
    assert found.fixes == 12


def test_the_robust_one_is_the_plain_one_for_a_gaussian_and_shrugs_at_outliers() -> None:
    values = np.random.default_rng(0).normal(0, 0.02, (400, 20, 2))
    clean = measure(fixes(values, 20))
    assert clean.cm2 == pytest.approx([4.0, 4.0], rel=0.06)
    assert clean.robust_cm2 == pytest.approx([4.0, 4.0], rel=0.08)
    values[:, 0] += 1.0
    spoilt = measure(fixes(values, 20))
    assert (spoilt.cm2 > 100).all()
    assert spoilt.robust_cm2 == pytest.approx([4.0, 4.0], rel=0.25)


def test_the_interval_holds_what_other_markers_would_have_given() -> None:
    """Every marker errs by its own constant: the variance over all possible ones is 4 cm²."""
    rng = np.random.default_rng(5)
    held = 0
    trials = 200
    for _ in range(trials):
        own = rng.normal(0, 0.02, (1, 24, 2)) + rng.normal(0, 0.002, (10, 24, 2))
        found = measure(fixes(own, 24))
        held += bool(found.low_cm2[0] <= 4.0 * 1.01 <= found.high_cm2[0])
    assert held / trials >= 0.90


@pytest.mark.parametrize("size", [2, 3])
def test_the_interval_of_subsets_holds_it_too(size: int) -> None:
    """A fix is the mean of what its markers say: its variance over all markers is 4 cm² / size."""
    rng = np.random.default_rng(6)
    members = subsets(24, size)
    held, trials = 0, 150
    for _ in range(trials):
        own = rng.normal(0, 0.02, (1, 24, 2)) + rng.normal(0, 0.002, (4, 24, 2))
        values = np.zeros((4, len(members), 3))
        values[..., :2] = own[:, members].mean(axis=2)
        layouts = Layouts(tuple(range(24)), members, len(members))
        found = measure(SubsetFixes(layouts, values, np.ones(values.shape[:2], dtype=bool)))
        held += bool(found.low_cm2[0] <= 4.0 * 1.01 / size <= found.high_cm2[0])
    assert held / trials >= 0.87


def test_the_table_goes_through_settings(tmp_path: Path) -> None:
    folder = still_result(tmp_path / "six", MAP, noisy_frames(MAP, 8), truth=None)
    table = tmp_path / "tables" / "table.yaml"
    study = variance(folder, table, OPTIONS)
    content = yaml.safe_load(table.read_text())
    measured = study.tables[0].frame
    assert np.array(content["cm2"]) == pytest.approx(
        measured[["var_x_cm2", "var_y_cm2"]].to_numpy(), rel=1e-5
    )
    assert content["source"]["frames"] == 8
    assert content["source"]["subsets"] == [6, 15, 20, 15]

    settings = tmp_path / "settings.yaml"
    settings.write_text(
        "trackers:\n"
        "  own: {variance: {kind: table, path: tables/table.yaml}}\n"
        "  robust: {variance: {kind: table, path: tables/table.yaml, column: robust_cm2}}\n"
        "  mean: {variance: {kind: static, statistic: mean, path: tables/table.yaml}}\n"
    )
    loaded = load_settings(settings)
    own, robust = loaded.trackers["own"].variance, loaded.trackers["robust"].variance
    assert isinstance(own, TableVariance)
    assert isinstance(robust, TableVariance)
    assert [list(row) for row in own.table.cm2] == content["cm2"]
    assert [list(row) for row in robust.table.cm2] == content["robust_cm2"]
    mean = loaded.trackers["mean"].variance
    assert isinstance(mean, StaticVariance)
    assert mean.table == own.table

    # The resolved settings carry the numbers: the file may go.
    resolved = tmp_path / "resolved.yaml"
    resolved.write_bytes(settings_yaml(loaded, {}))
    table.unlink()
    assert load_settings(resolved) == loaded


def test_a_table_in_an_override(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "t.yaml").write_text("cm2: [[9, 4], [1, 1]]\n")
    monkeypatch.chdir(tmp_path)
    settings = load_settings(None, ["trackers.adaptive.variance.path=t.yaml"])
    adaptive = settings.trackers["adaptive"].variance
    assert isinstance(adaptive, TableVariance)
    assert adaptive.table.cm2 == ((9.0, 4.0), (1.0, 1.0))
    assert settings.trackers["min"] == PipelineSettings().trackers["min"]


@pytest.mark.parametrize(
    ("variance_text", "table_text", "parts"),
    [
        ("{kind: table, path: none.yaml}", "", ["none.yaml", "found none"]),
        ("{kind: table, path: t.yaml}", "cm2: []", ["t.yaml", "cm2", "at least 1"]),
        ("{kind: table, path: t.yaml}", "cm2: [[1]]", ["t.yaml", "cm2[0]", "2 items"]),
        ("{kind: table, path: t.yaml}", "cm2: [[1, -1]]", ["t.yaml", "cm2[0][1]", "-1"]),
        ("{kind: table, path: t.yaml}", "cm: [[1, 1]]", ["t.yaml", "cm2"]),
        ("{kind: table, path: t.yaml, column: robust_cm2}", "cm2: [[1, 1]]", ["robust_cm2"]),
        ("{kind: table, path: t.yaml, column: mad}", "cm2: [[1, 1]]", ["column", "mad"]),
        (
            "{kind: table, path: t.yaml, table: {cm2: [[1, 1]]}}",
            "cm2: [[1, 1]]",
            ["trackers.a.variance", "found both"],
        ),
        ("{kind: table, path: 3}", "cm2: [[1, 1]]", ["trackers.a.variance.path", "3"]),
        ("{kind: distance_count, path: t.yaml}", "cm2: [[1, 1]]", ["variance.path"]),
    ],
)
def test_a_mistake_is_one_line(
    variance_text: str, table_text: str, parts: list[str], tmp_path: Path
) -> None:
    (tmp_path / "t.yaml").write_text(table_text + "\n")
    settings = tmp_path / "settings.yaml"
    settings.write_text(f"trackers: {{a: {{variance: {variance_text}}}}}\n")
    with pytest.raises(InputError) as caught:
        load_settings(settings)
    assert "\n" not in str(caught.value)
    for part in parts:
        assert part in str(caught.value)


def test_too_few_fixes_are_named_and_not_written(tmp_path: Path) -> None:
    folder = still_result(tmp_path / "short", MAP, noisy_frames(MAP, 2))
    table = tmp_path / "table.yaml"
    # 12, 30, 40, 30, 12 fixes with one to five markers, 2 with all six.
    study = variance(folder, table, SubsetOptions(n_frames=None, progress=False))
    assert len(yaml.safe_load(table.read_text())["cm2"]) == 5
    assert np.isnan(study.tables[0].frame["var_x_cm2"].iloc[5])
    assert "from 6 markers on" in text(study)


def test_nothing_to_measure_writes_nothing(tmp_path: Path) -> None:
    frame = noisy_frames(MAP, 1)[0].select([0])
    folder = still_result(tmp_path / "one", MAP, [frame])
    with pytest.raises(InputError, match="at least 5 markers"):
        variance(folder, tmp_path / "table.yaml", OPTIONS)
    assert not (tmp_path / "table.yaml").exists()


def test_on_the_command_line(tmp_path: Path) -> None:
    folder = still_result(tmp_path / "six", MAP, noisy_frames(MAP, 4))
    assert CliRunner().invoke(analyze(), ["variance", str(folder)]).exit_code == 2
    table = tmp_path / "t.yaml"
    run = CliRunner().invoke(analyze(), ["variance", str(folder), "-o", str(table), "--max", "3"])
    assert run.exit_code == 0
    assert len(read_table(table)) == len(read_table(table, "robust_cm2")) == 3
