"""`arucolog map survey` on rendered drives, from the command line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result

from pipeline.geometry import Pose
from pipeline.localizer import PipelineSettings
from pipeline.markers import Marker, MarkerMap
from recorder.errors import InputError
from recorder.files.map_file import map_yaml, parse_map
from recorder.log.reader import LogReader
from recorder.record import record
from recorder.simulation.scene_file import load_scene, shipped_scenes
from recorder.sources.opening import open_source
from replay.survey.logs import expected_edges, survey_logs
from replay.survey.report import refined_yaml
from replay.survey.results import SurveyOptions
from replay.survey.sightings import Span
from replay.survey_cli import survey as survey_command
from tests import worlds
from tests.test_cli import arucolog
from tests.test_survey import errors, misplaced, rms_m

ROOT = Path(__file__).resolve().parents[1]
FIXED = frozenset({0, 19})


def hand_map() -> MarkerMap:
    """A ceiling of five by four markers, with what a survey has to keep: tags, a size, a std."""
    markers = []
    for i in range(20):
        row, col = divmod(i, 5)
        xyz = ((col - 2) * 0.6, (row - 1.5) * 0.6, 2.4)
        size, tags = (0.16, ("door", "big")) if i == 7 else (0.15, ())
        std_m = 0.02 if i == 8 else None
        markers.append(Marker.from_yaw(i, xyz, 0.7 * i, "down", size, std_m, tags))
    return MarkerMap("hall", "DICT_6X6_1000", tuple(markers))


def scene(folder: Path, frames: int) -> Path:
    """Two loops under markers that are 1 cm and 1 degree off, with noise, blur and JPEG."""
    told = hand_map()
    true = misplaced(told, 21, fixed=FIXED)
    (folder / "rough.yaml").write_bytes(map_yaml(told))
    (folder / "true.yaml").write_bytes(map_yaml(true))
    rng = np.random.default_rng(21)
    points = []
    for k in range(17):
        angle, reach = 2 * np.pi * k / 8, 1.0 if k < 8 else 0.45
        tilt = [float(v) for v in rng.normal(0, 0.7, 2)]
        points.append(
            {
                "t_s": frames / 10 * k / 16,
                "xyz_m": [
                    0.9 * reach * float(np.cos(angle)),
                    0.7 * reach * float(np.sin(angle)),
                    0.3,
                ],
                "yaw_deg": 90 * float(np.sin(angle)) + 10.0 * k,
                "roll_deg": tilt[0],
                "pitch_deg": tilt[1],
            }
        )
    content: dict[str, Any] = {
        "seed": 21,
        "rate_hz": 10,
        "frames": frames,
        "camera": {
            "width_px": 1280,
            "height_px": 720,
            "diagonal_fov_deg": 92,
            "dist_coeffs": [-0.1, 0.02, 0.0003, -0.0002, 0.0],
        },
        "map": "rough.yaml",
        "true_map": "true.yaml",
        "trajectory": {"kind": "waypoints", "looking": "up", "points": points},
        "image": {"exposure_s": 0.004, "blur_px": 0.6, "noise_std": 2.0, "jpeg_quality": 90},
        "surface": {"height_m": 2.43, "grey": 0.7, "texture": "plaster"},
    }
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("survey")
    record(open_source(str(scene(folder, 64))), folder / "drive.mcap")
    return folder


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(survey_command, [*map(str, arguments)])


def read(path: Path) -> MarkerMap:
    return parse_map(path.read_bytes(), path)


def test_a_rendered_drive_makes_the_map_five_times_better(site: Path) -> None:
    done = arucolog(
        *("map", "survey", "drive.mcap", "--map", "rough.yaml", "--fix", "0,19"),
        *("-o", "refined.yaml", "--json"),
        cwd=site,
    )
    assert done.returncode == 0, done.stderr
    told, true, refined = (read(site / f"{name}.yaml") for name in ("rough", "true", "refined"))
    before, after = rms_m(told, true, FIXED), rms_m(refined, true, FIXED)
    turns = [
        np.degrees(np.sqrt((errors(m, true, FIXED)[:, 3:] ** 2).mean(axis=0)))
        for m in (told, refined)
    ]
    print(
        f"position {1e3 * before:.1f} mm -> {1e3 * after:.2f} mm ({before / after:.0f} times); "
        f"tilt x, tilt y, yaw {turns[0].round(2)} -> {turns[1].round(3)} deg"
    )
    assert before > 0.01
    assert before / after >= 5
    assert turns[0][2] / turns[1][2] >= 5
    assert turns[0][:2].mean() / turns[1][:2].mean() >= 5

    found = json.loads(done.stdout)
    assert found["reprojection_rms_before_px"] > 5 * found["reprojection_rms_after_px"]
    # As far inside as this detector is known to put edges, and better known than before.
    expected = expected_edges(PipelineSettings().detector, told)
    sigma_px = found["edge_inset_sigma_px"]
    print(f"edges {found['edge_inset_px']:.3f} ± {sigma_px:.3f} px, expected {expected}")
    assert sigma_px < expected.std_px
    bound_px = 2 * float(np.hypot(sigma_px, expected.std_px))
    assert found["edge_inset_px"] == pytest.approx(expected.mean_px, abs=bound_px)
    assert found["groups"] == [list(range(20))]
    assert found["unseen"] == []
    free = [m for m in found["markers"] if not m["fixed"]]
    sigmas = np.array([m["shift_sigma_m"] for m in free])
    pulls = errors(refined, true, FIXED)[:, :3] / sigmas
    print(f"pulls of x, y, z: {np.sqrt((pulls**2).mean(axis=0)).round(2)}")
    assert 0.4 < np.sqrt((pulls**2).mean()) < 2.5

    # What was not refined is as it was.
    assert (refined.frame, refined.dictionary) == (told.frame, told.dictionary)
    assert refined.by_id[7].tags == ("door", "big")
    assert refined.by_id[7].size_m == 0.16
    for marker_id in FIXED:
        np.testing.assert_array_equal(
            refined.by_id[marker_id].corners_m, told.by_id[marker_id].corners_m
        )
    stated = {m["id"]: np.sqrt(np.mean(np.square(m["shift_sigma_m"]))) for m in free}
    for marker_id, std_m in stated.items():
        assert refined.by_id[marker_id].std_m == pytest.approx(std_m, abs=1e-6)
    text = (site / "refined.yaml").read_text()
    assert text.startswith("# Marker poses refined by `arucolog map survey`.\n# log: drive.mcap")
    with LogReader(site / "drive.mcap") as reader:
        assert reader.sha256() in text
    assert found["sources"]["rough.yaml"] in text
    assert "\n# the camera's calibration is taken as exact: its errors are not in std_m\n" in text


def test_the_report_for_people(site: Path) -> None:
    done = run(site / "drive.mcap", "--fix", "0,19", "--every", "2", "--max-frames", "20")
    assert done.exit_code == 0, done.output
    rows = {line.split()[0]: line for line in done.stdout.splitlines() if line.strip()}
    assert rows["0"].endswith("fixed")
    assert rows["19"].endswith("fixed")
    assert len(rows["5"].split()) >= 12
    assert "20 frames used of 32 looked at (12 from where others are)" in done.stdout
    assert "the camera's calibration is taken as exact" in done.stdout


@pytest.mark.slow
def test_a_level_camera_and_nothing_fixed() -> None:
    """At one height, nothing but small errors tells the map's scale from the edges' inset.

    Corners taken for independent draws would make this map six times worse than the tape measure,
    by 2 % in scale.
    """
    true = load_scene(shipped_scenes()["sample"]).true_map
    log = ROOT / "logs/sample.mcap"
    span = Span(every=2, progress=False)
    found = survey_logs([log], None, None, PipelineSettings(), SurveyOptions(), span).survey
    with LogReader(log) as reader:
        told = reader.marker_map()
    assert told is not None
    nobody = frozenset[int]()
    before, after = rms_m(told, true, nobody), rms_m(found.refined, true, nobody)
    print(f"{1e3 * before:.2f} -> {1e3 * after:.2f} mm, edges {found.edge_px:.2f} px inside")
    assert after < 1.2 * before
    # Of what no single marker shares with the whole, more is known than before.
    assert found.rms_after_px < 0.6 * found.rms_before_px


def test_the_same_again_and_files_that_exist(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(site)
    command = ("drive.mcap", "--map", "rough.yaml", "--every", "8")
    first = run(*command, "-o", "a.yaml", "--jobs", "1")
    second = run(*command, "-o", "b.yaml", "--jobs", "2")
    assert first.exit_code == second.exit_code == 0, first.output + second.output
    assert (site / "a.yaml").read_bytes() == (site / "b.yaml").read_bytes()
    third = run(*command, "-o", "a.yaml")
    assert isinstance(third.exception, InputError)
    assert "--force" in str(third.exception)
    assert (site / "a.yaml").read_bytes() == (site / "b.yaml").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "code", "part"),
    [
        (["none.mcap"], 1, "none.mcap"),
        (["{log}", "--fix", "75-77"], 1, "expected the markers to fix, found no 75, 76, 77"),
        (["{log}", "--fix", "0,x"], 2, "expected ids such as 0-23,30, found '0,x'"),
        (["{log}", "--std-m", "0"], 2, "above 0"),
        (["{log}", "--map", "none.yaml"], 1, "none.yaml: expected a file"),
        (["{log}", "-o", "no/such/folder.yaml"], 1, "expected the folder no/such"),
        (["{log}", "--from", "99"], 1, "found none (0 images"),
        (["none.mcap", "--from", "2", "--to", "1"], 2, "--to"),
        ([], 2, "LOG"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    arguments: list[str],
    code: int,
    part: str,
    tmp_path: Path,
    site: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run(*(a.replace("{log}", str(site / "drive.mcap")) for a in arguments))
    if code == 1:
        assert isinstance(done.exception, InputError)
        assert part in str(done.exception)
    else:
        assert done.exit_code == code
        assert part in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_map_of_another_place_gives_no_map(site: Path, tmp_path: Path) -> None:
    """The same markers, hung up in another order."""
    told, out = hand_map(), tmp_path / "refined.yaml"
    order = np.random.default_rng(0).permutation(len(told.markers))
    other = [
        Marker.from_pose(marker.id, told.markers[i].T_map_marker, marker.size_m)
        for marker, i in zip(told.markers, order, strict=True)
    ]
    path = tmp_path / "other.yaml"
    path.write_bytes(map_yaml(replace(told, markers=tuple(other))))
    done = run(site / "drive.mcap", "--map", path, "--every", "4", "-o", out)
    assert isinstance(done.exception, InputError)
    assert "other.yaml: expected a map in which most images" in str(done.exception)
    assert "of 16 without one: is it of this place" in str(done.exception)
    assert not out.exists()


@pytest.mark.parametrize("seed", [3, 13])
def test_a_map_in_millimetres_gives_no_map(seed: int, tmp_path: Path) -> None:
    """Its sides are in metres; where few corners fit, the edges alone would not tell."""
    sample = ROOT / "logs" / "sample.mcap"
    with LogReader(sample) as log:
        told = log.marker_map()
    assert told is not None
    rng = np.random.default_rng(seed)
    poses = [
        Pose(m.T_map_marker.rotation, 1000 * (m.T_map_marker.translation + rng.normal(0, 0.01, 3)))
        for m in told.markers
    ]
    markers = (
        Marker.from_pose(m.id, p, m.size_m) for m, p in zip(told.markers, poses, strict=True)
    )
    path, out = tmp_path / "rough.yaml", tmp_path / "refined.yaml"
    path.write_bytes(map_yaml(replace(told, markers=tuple(markers))))
    done = run(sample, "--map", path, "-o", out)
    assert isinstance(done.exception, InputError)
    assert not out.exists()


def test_logs_of_different_cameras(site: Path, tmp_path: Path) -> None:
    other = worlds.small_log(tmp_path / "other.mcap", 3)
    done = run(site / "drive.mcap", other, "--every", "32")
    assert isinstance(done.exception, InputError)
    assert "other.mcap: expected the first log's calibration, found another" in str(done.exception)


def test_logs_of_the_same_name_are_told_apart(site: Path, tmp_path: Path) -> None:
    logs = [tmp_path / day / "drive.mcap" for day in ("monday", "tuesday")]
    for log in logs:
        log.parent.mkdir()
        log.symlink_to(site / "drive.mcap")
    span = Span(every=16, progress=False)
    done = survey_logs(logs, None, None, PipelineSettings(), SurveyOptions(), span)
    *sources, map_name = done.sources
    assert sources == [str(log) for log in logs]
    assert map_name == "map.yaml of drive.mcap"
    header = refined_yaml(done.survey, done.sources).decode()
    assert all(f"# log: {log} sha256:{done.sources[str(log)]}" in header for log in logs)


def test_help_ends_in_a_worked_example() -> None:
    done = arucolog("map", "survey", "--help")
    *_, title, example = done.stdout.strip().splitlines()
    assert title.strip() == "Example:"
    assert example.strip().startswith("arucolog map survey")
