"""One contract for every variance model, and what each of them promises beyond it."""

from __future__ import annotations

import runpy
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.geometry import Pose
from pipeline.localizer import PipelineSettings
from pipeline.pose import PoseFix, RansacIterative
from pipeline.tracker import ConstantVelocity
from pipeline.variance import (
    PAPER_TABLE,
    AnyVarianceModel,
    CustomVariance,
    DistanceCountVariance,
    FittedVariance,
    ReprojectionVariance,
    StaticVariance,
    TableVariance,
    UnknownVariance,
    Variance,
    VarianceModel,
    VarianceTable,
)
from recorder.errors import InputError
from replay.result import open_result
from replay.run import ReplayOptions, replay
from replay.settings_file import load_settings, settings_yaml
from tests import worlds

ROOT = Path(__file__).resolve().parents[1]
OWN_TABLE = VarianceTable(cm2=((9.0, 4.0), (3.0, 2.0), (1.0, 0.5)))


class HeightVariance(CustomVariance):
    """A user's model: what is higher up is trusted less."""

    per_m_cm2: float = 2.0

    def __call__(self, fix: PoseFix) -> Variance:
        assert fix.T_map_camera is not None
        sigma2 = self.per_m_cm2 * 1e-4 * (1.0 + abs(float(fix.T_map_camera.translation[2])))
        return Variance(sigma2, sigma2)


MODELS: dict[str, AnyVarianceModel] = {
    "table": TableVariance(),
    "static": StaticVariance(statistic="median"),
    "fitted": FittedVariance(table=OWN_TABLE),
    "distance_count": DistanceCountVariance(),
    "reprojection": ReprojectionVariance(),
    "reprojection of distance_count": ReprojectionVariance(
        base=DistanceCountVariance(power=2.0), expected_px=0.3
    ),
    "own": HeightVariance(per_m_cm2=5.0),
}


def fix_with(
    n: int = 4, *, distance_m: float = 2.0, rms_px: float = 0.75, n_explained: int | None = None
) -> PoseFix:
    pose = Pose(np.eye(3), np.array([1.0, 2.0, 0.3]))
    explained = n if n_explained is None else n_explained
    return PoseFix(
        "ok", n, tuple(range(n)), explained, pose, rms_px, rms_px, mean_distance_m=distance_m
    )


@pytest.fixture(scope="module")
def fixes() -> list[PoseFix]:
    """What the solver makes of noisy corners: one to twelve markers, several heights."""
    camera, ceiling = worlds.camera(), worlds.ceiling()
    found = []
    for seed, z_m in enumerate((0.0, 0.3, 1.0, 1.4)):
        seen = worlds.corners(worlds.looking_up(z_m=z_m), camera, ceiling)
        detections = worlds.with_noise(seen, 0.4, seed)
        for n in range(1, 13):
            fix = RansacIterative(max_markers=n)(detections, camera, ceiling, 0.0)
            if fix.status == "ok":
                found.append(fix)
    assert {fix.n_used for fix in found} >= set(range(1, 7))
    return found


@pytest.mark.parametrize("name", list(MODELS))
def test_every_model_keeps_the_contract(name: str, fixes: list[PoseFix], tmp_path: Path) -> None:
    model: VarianceModel = MODELS[name]
    settings = PipelineSettings(trackers={"own": ConstantVelocity(variance=MODELS[name])})
    tracker = settings.trackers["own"].build()
    for i, fix in enumerate(fixes):
        variance = model(fix)
        assert all(np.isfinite(value) and value > 0 for value in variance)
        assert variance == model(fix)
        state = tracker.step(i * 10**8, fix)
        assert state.updated
        np.testing.assert_allclose(state.r_m2, 0.25 * np.array(variance))
        assert np.isfinite(state.x).all()
        assert (np.linalg.eigvalsh(state.P) > -1e-12).all()

    path = tmp_path / "settings.yaml"
    path.write_bytes(settings_yaml(settings, {}))
    read = load_settings(path)
    assert read == settings
    again = read.trackers["own"].variance
    assert [again(fix) for fix in fixes] == [model(fix) for fix in fixes]


def test_a_fix_knows_its_mean_distance_to_the_markers_used() -> None:
    camera, ceiling = worlds.camera(), worlds.ceiling()
    T_map_camera = worlds.looking_up(0.1, -0.2, 0.3)
    fix = RansacIterative(max_markers=5)(
        worlds.corners(T_map_camera, camera, ceiling), camera, ceiling, 0.0
    )
    assert fix.n_used == 5
    by_hand = [
        np.linalg.norm(ceiling.by_id[i].centre_m - T_map_camera.translation) for i in fix.used_ids
    ]
    assert fix.mean_distance_m == pytest.approx(float(np.mean(by_hand)), abs=1e-5)


@pytest.mark.parametrize("name", ["table", "fitted", "distance_count", "reprojection"])
def test_more_markers_never_make_it_worse(name: str) -> None:
    # The residual that so many markers are expected to leave.
    rms = [0.75 * np.sqrt((8 * n - 6) / (8 * n)) for n in range(1, 20)]
    variances = [MODELS[name](fix_with(n, rms_px=rms[n - 1])) for n in range(1, 20)]
    for fewer, more in pairwise(variances):
        assert all(b <= a * (1 + 1e-12) for a, b in zip(fewer, more, strict=True))
    assert variances[-1].x_m2 < variances[0].x_m2


def test_distance_count_is_scale_d2_over_n_to_the_power() -> None:
    model = DistanceCountVariance(scale_cm2_per_m2=(200.0, 100.0), power=2.0, max_markers=4)
    # 200 cm² · 3² / 2² = 450 cm².
    assert model(fix_with(2, distance_m=3.0)) == pytest.approx((0.0450, 0.0225))
    assert model(fix_with(9, distance_m=3.0)) == model(fix_with(4, distance_m=3.0))
    near, far = (model(fix_with(3, distance_m=d)).x_m2 for d in (1.0, 2.5))
    assert far / near == pytest.approx(2.5**2)


def test_distance_count_is_of_the_papers_size_at_the_papers_distance() -> None:
    rings = np.array([1 / 3] * 8 + [2 / 3] * 16)
    distance_m = float(np.hypot(2.991, rings).mean())
    for n in range(1, 8):
        model = DistanceCountVariance()(fix_with(n, distance_m=distance_m))
        for ours, papers in zip(model, PAPER_TABLE.row(n), strict=True):
            assert 1 / 2.5 < ours / papers < 2.5


def test_reprojection_scales_by_how_much_worse_it_fits_than_expected() -> None:
    model = ReprojectionVariance(base=TableVariance(), expected_px=0.5)
    base = TableVariance()(fix_with(3))
    # Three markers: 24 numbers, 6 of them fitted, so 0.5 px shrink to sqrt(0.75) of it.
    as_expected = model(fix_with(3, rms_px=0.5 * np.sqrt(0.75)))
    assert as_expected == pytest.approx(tuple(base))
    worse = model(fix_with(3, rms_px=1.5 * np.sqrt(0.75)))
    assert worse == pytest.approx((9 * base.x_m2, 9 * base.y_m2))
    # RANSAC's outliers are used, but the residual is that of the explained ones.
    of_two = model(fix_with(3, rms_px=0.5, n_explained=2))
    assert of_two.x_m2 == pytest.approx(base.x_m2 / 0.625)


def test_reprojection_stays_within_its_limits() -> None:
    model = ReprojectionVariance(min_factor=0.5, max_factor=4.0)
    base = TableVariance()(fix_with(2))
    assert model(fix_with(2, rms_px=0.0)).x_m2 == pytest.approx(0.5 * base.x_m2)
    assert model(fix_with(2, rms_px=50.0)).y_m2 == pytest.approx(4.0 * base.y_m2)
    with pytest.raises(ValidationError, match="min_factor up to max_factor"):
        ReprojectionVariance(min_factor=2.0, max_factor=1.0)


def test_what_a_model_needs_and_a_fix_lacks_is_named() -> None:
    with pytest.raises(ValueError, match="expected mean_distance_m"):
        DistanceCountVariance()(fix_with(distance_m=np.nan))
    with pytest.raises(ValueError, match="expected reprojection_rms_px"):
        ReprojectionVariance()(fix_with(rms_px=np.nan))


def test_fitted_never_falls_back_on_the_papers_table(tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text("trackers: {mine: {variance: {kind: fitted}}}")
    with pytest.raises(InputError, match="table"):
        load_settings(path)
    (tmp_path / "table.yaml").write_text("cm2: [[9, 4], [3, 2], [1, 0.5]]")
    path.write_text("trackers: {mine: {variance: {kind: fitted, path: table.yaml}}}")
    assert load_settings(path).trackers["mine"].variance == FittedVariance(table=OWN_TABLE)
    path.write_text(
        "trackers: {mine: {variance: {kind: reprojection, base: {kind: fitted, path: table.yaml}}}}"
    )
    variance = load_settings(path).trackers["mine"].variance
    assert variance == ReprojectionVariance(base=FittedVariance(table=OWN_TABLE))


def test_a_model_whose_class_is_unknown_is_kept_but_not_replayed(tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text("trackers: {own: {variance: {kind: custom, name: Elsewhere, depth: 3}}}")
    settings = load_settings(path)
    variance = settings.trackers["own"].variance
    assert isinstance(variance, UnknownVariance)
    assert variance.model_dump() == {"kind": "custom", "name": "Elsewhere", "depth": 3}
    path.write_bytes(settings_yaml(settings, {}))
    assert load_settings(path) == settings
    with pytest.raises(ValueError, match="expected a class Elsewhere"):
        variance(fix_with())
    log = worlds.small_log(tmp_path / "log.mcap", 2)
    with pytest.raises(InputError, match="found the custom model Elsewhere"):
        replay(log, tmp_path / "out", "own", ReplayOptions(settings=settings, rrd=False))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "variance",
    [
        "{kind: custom}",
        "{kind: custom, name: HeightVariance, per_m: 3}",
        "{kind: mine}",
        "{kind: distance_count, power: -1}",
        "{kind: distance_count, scale_cm2_per_m2: [1, 0]}",
        "{kind: reprojection, base: {kind: reprojection}}",
    ],
)
def test_settings_that_make_no_sense_are_refused(variance: str, tmp_path: Path) -> None:
    path = tmp_path / "settings.yaml"
    path.write_text(f"trackers: {{own: {{variance: {variance}}}}}")
    with pytest.raises(InputError):
        load_settings(path)


def test_the_example_of_an_own_model_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = worlds.small_log(tmp_path / "log.mcap", 6)
    settings = tmp_path / "settings.yaml"
    settings.write_text("trackers: {adaptive: {variance: {kind: table}}}")
    example = runpy.run_path(str(ROOT / "examples" / "own_variance.py"))
    example["main"](log, tmp_path / "result", settings)
    assert "level" in capsys.readouterr().out
    variance = open_result(tmp_path / "result").settings.trackers["level"].variance
    assert variance.model_dump() == {
        "kind": "custom",
        "name": "LevelCameraVariance",
        "std_m": 0.01,
    }
