"""settings.yaml and --set: defaults, one-line errors, round trips, digests."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.localizer import PAPER_TRACKERS, PipelineSettings
from pipeline.pose import RansacIterative
from recorder.errors import InputError
from replay.settings_file import digest, load_settings, settings_yaml

DESIGN = """\
detector: {kind: aruco, corner_refinement: contour}
pose:
  kind: ransac_iterative
  max_markers: null
  selection: nearest_center
  max_reprojection_px: 5.0
trackers:
  adaptive: {kind: constant_velocity, accel_std: 0.01, r_scale: 0.25, variance: {kind: table}}
  min:
    kind: constant_velocity
    accel_std: 0.01
    r_scale: 0.25
    variance: {kind: static, statistic: min}
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    return path


def test_without_a_file_the_papers_settings() -> None:
    settings = load_settings(None)
    assert settings == PipelineSettings()
    assert settings.trackers == PAPER_TRACKERS
    assert settings.detector.corner_refinement == "contour"


def test_the_designs_example(tmp_path: Path) -> None:
    settings = load_settings(written(tmp_path, DESIGN))
    assert settings.pose == RansacIterative()
    assert settings.trackers == {name: PAPER_TRACKERS[name] for name in ("adaptive", "min")}


def test_an_empty_file_is_the_default(tmp_path: Path) -> None:
    assert load_settings(written(tmp_path, "# nothing yet\n")) == PipelineSettings()


def test_resolved_settings_are_read_back_the_same(tmp_path: Path) -> None:
    settings = load_settings(
        written(tmp_path, DESIGN),
        ["pose.max_markers=[{until_s: 12, n: 1}, {n: null}]", "detector.corner_refinement=subpix"],
    )
    data = settings_yaml(settings, {"opencv": "5"})
    path = tmp_path / "resolved.yaml"
    path.write_bytes(data)
    assert load_settings(path) == settings
    assert data.startswith(b"# opencv: 5\n")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("pose: {max_marker: 3}", ["pose.max_marker", "max_markers"]),
        ("pose: {max_markers: 0}", ["pose.max_markers", "0"]),
        ("detector: {corner_refinement: best}", ["detector.corner_refinement", "contour", "best"]),
        ("trackers: {}", ["trackers", "at least one"]),
        ("trackers: {fixes: {accel_std: 1}}", ["trackers", "another name"]),
        ("detector: {parameters: {perspectiveRemovePixelPerCell: 0}}", ["parameters", "OpenCV"]),
        ("trackers: {a: {variance: {kind: guess}}}", ["trackers.a.variance", "static", "guess"]),
        ("detector: {parameters: {adaptiveThreshWin: 3}}", ["parameters", "adaptiveThreshWin"]),
        ("- a list", ["list"]),
        ("pose: [", ["line"]),
    ],
)
def test_a_mistake_is_one_line_with_file_key_and_what_was_found(
    text: str, parts: list[str], tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        load_settings(written(tmp_path, text))
    message = str(caught.value)
    assert "\n" not in message
    for part in ["settings.yaml", *parts]:
        assert part in message


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("pose.max_markers", ["KEY=VALUE"]),
        ("pose.max_marker=3", ["max_marker"]),
        ("poses.max_markers=3", ["detector, pose, trackers"]),
        ("trackers.adaptive.accel_std=fast", ["accel_std", "fast"]),
        (
            "trackers.adaptive.variance.statistic=min",
            ["variance.statistic: ", "known here: kind, table"],
        ),
        ("trackers.min.variance.table.cm=1", ["variance.table.cm: ", "did you mean cm2"]),
    ],
)
def test_a_mistake_in_set_names_the_override(override: str, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load_settings(None, [override])
    for part in [override, *parts]:
        assert part in str(caught.value)


def test_set_changes_one_thing() -> None:
    settings = load_settings(None, ["trackers.min.accel_std=0.1", "pose.max_markers=3"])
    assert settings.trackers["min"].accel_std == 0.1
    assert settings.trackers["max"].accel_std == 0.01
    assert settings.pose.max_markers == 3


def test_the_digest_is_of_the_values_not_of_the_text(tmp_path: Path) -> None:
    short, long = load_settings(None), load_settings(None, ["pose.max_reprojection_px=5"])
    assert digest(short) == digest(long)
    assert digest(short) != digest(load_settings(None, ["pose.max_reprojection_px=4"]))
    assert digest(short) != digest(short, from_s=1.0)
    assert digest(short) == digest(short, from_s=None)
