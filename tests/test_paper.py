"""The paper's experiments: its numbers as printed, noise like the detector's, a small run whole."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.paper.configuration_two import LIMITS, PAPER_FILTERS, SIDES
from analysis.paper.corner_noise import SLANTS_DEG, NoisyCorners, jittered, measure, slant_deg
from analysis.paper.experiments import FITTED, Experiments, run, ticks
from analysis.paper.findings.all import all_findings
from analysis.paper.findings.finding import Finding
from analysis.paper.page import anchor, write_page
from analysis.paper.references import COUNT, PLACEMENT_HIGH, PLACEMENT_LOW
from analysis.paper.tracking_tables import consistency_sentences, tracking_tables
from pipeline.detection import ArucoDetection
from pipeline.pose import RansacIterative
from pipeline.variance import PAPER_TABLE
from recorder.simulation.quads import marker_quads
from recorder.simulation.renderer import Renderer
from recorder.simulation.scene_file import shipped_scenes
from recorder.simulation.source import SceneSource
from tests import worlds


def test_every_number_is_the_papers(shared_data: Path) -> None:
    """Each row of the tables stands in the paper's text, in order."""
    texts = sorted((shared_data.parent / "paper").glob("*.txt"))
    if not texts:
        pytest.skip("the paper's text is not here")
    text = re.sub(r"\\textbf\{([^}]*)\}", r"\1", texts[0].read_text())
    numbers = [re.findall(r"-?\d+\.\d+", line) for line in text.splitlines() if "&" in line]
    for row in (*PLACEMENT_LOW.values(), *PLACEMENT_HIGH.values(), *COUNT.values()):
        assert any([float(x) for x in found[-6:]] == list(row) for found in numbers), row
    for variances in PAPER_TABLE.cm2:
        assert any(tuple(map(float, found)) == variances for found in numbers), variances


def test_noisy_corners_err_like_the_detector() -> None:
    """Single-marker errors from drawn noise are those of rendered frames, in size."""
    camera, marker_map = worlds.camera(ideal=True), worlds.ceiling()
    renderer = Renderer(camera, marker_quads(marker_map))
    poses = jittered([worlds.looking_up(0.1, 0.05)] * 16, seed=3, spread_m=0.02)
    detector = ArucoDetection()
    noise = measure(renderer, camera, marker_map, poses, detector)
    # CONTOUR moves each edge half a pixel inwards: corners by 0.71 px.
    assert noise.inward_px() == pytest.approx(np.sqrt(0.5), abs=0.12)
    rng = np.random.default_rng(5)
    drawn, find = NoisyCorners(camera, marker_map, noise), detector.build(marker_map)
    solver = RansacIterative()
    sizes: dict[str, list[float]] = {"rendered": [], "drawn": []}
    for index, pose in enumerate(poses):
        for kind, seen in (
            ("rendered", find(renderer.capture(pose, index))),
            ("drawn", drawn(pose, rng)),
        ):
            for i in range(len(seen)):
                fix = solver(seen.select([i]), camera, marker_map, 0.0)
                if fix.T_map_camera is not None:
                    error = fix.T_map_camera.translation - pose.translation
                    sizes[kind].append(float(np.hypot(error[0], error[1])))
    medians = {kind: float(np.median(values)) for kind, values in sizes.items()}
    assert medians["drawn"] == pytest.approx(medians["rendered"], rel=0.6)


@pytest.fixture(scope="module")
def runs() -> Experiments:
    ticked = []
    found = run(2, lambda: ticked.append(1))
    assert len(ticked) == ticks(2)
    return found


@pytest.mark.slow
def test_two_seeds_make_a_whole_page(runs: Experiments, tmp_path: Path) -> None:
    write_page(runs, tmp_path / "paper.md")
    text = (tmp_path / "paper.md").read_text()
    assert "nan" not in text
    findings = all_findings(runs)
    headings = {anchor(h) for h in re.findall(r"^#+ (.*)$", text, re.MULTILINE)}
    links = re.findall(r"\]\(#([^)]+)\)", text)
    assert {anchor(f.title) for f in findings} <= set(links) <= headings
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert len(pictures) == len(set(pictures)) == len(list((tmp_path / "paper").iterdir()))
    for picture in pictures:
        assert (tmp_path / picture).stat().st_size > 10_000
    # Each finding has its picture, or says where it is.
    for finding in findings:
        section = text.split(f"\n### {finding.title}\n")[1].split("\n##")[0]
        assert "![" in section or "Figure: *" in section


@pytest.mark.slow
def test_the_drives_noise_is_the_detectors_for_each_slant(runs: Experiments) -> None:
    """Single-marker errors on the top side: rendered frames against drawn corners."""
    site = runs.sites["configuration_2"]
    renderer = SceneSource(shipped_scenes()["configuration_2"]).renderer()
    find, solver = ArucoDetection().build(site.marker_map), RansacIterative()
    drawn = NoisyCorners(site.scene.true_camera, site.scene.true_map, site.noise)
    rng = np.random.default_rng(7)
    poses = jittered([site.scene.pose(t) for t in np.linspace(0.0, 58.0, 30)], 9, 0.02)
    errors: dict[tuple[str, float], list[float]] = {}
    for index, pose in enumerate(poses):
        for kind, seen in (
            ("rendered", find(renderer.capture(pose, index))),
            ("drawn", drawn(pose, rng)),
        ):
            for i in range(len(seen)):
                fix = solver(seen.select([i]), site.camera, site.marker_map, 0.0)
                if fix.T_map_camera is not None:
                    error = fix.T_map_camera.translation - pose.translation
                    key = kind, slant_deg(seen.corners_px[i])
                    errors.setdefault(key, []).append(float(np.hypot(error[0], error[1])))
    medians = {key: float(np.median(values)) for key, values in errors.items()}
    for slant in SLANTS_DEG:
        assert medians["drawn", slant] == pytest.approx(medians["rendered", slant], rel=0.5)
    # One noise for all markers would not do.
    assert medians["rendered", 0.0] > 3.0 * medians["rendered", 22.5]


@pytest.mark.slow
def test_consistency_is_said_of_every_filter_and_speed(runs: Experiments) -> None:
    sentences = consistency_sentences(runs)
    for name in (*PAPER_FILTERS, *(FITTED + name for name in PAPER_FILTERS)):
        (said,) = (s for s in sentences if s.startswith(f"{name} is ") and "mean NIS" in s)
        assert "expected" in said
    tables = {table.name: table.frame for table in tracking_tables(runs)}
    for speed in ("0_05", "0_2", "0_5"):
        frame = tables[f"consistency_{speed}"]
        assert len(frame) == 11
        numbers = frame.drop(columns=["tracker", "verdict"]).to_numpy(dtype=float)
        assert np.isfinite(numbers).all()
        assert set(frame["verdict"]) <= {"overconfident", "underconfident", "consistent"}
        assert len(tables[f"tracking_by_side_{speed}"]) == 4 * 12


@pytest.mark.slow
def test_the_drive_has_the_papers_limits(runs: Experiments) -> None:
    for outcomes in runs.drives.values():
        for side, most in zip(SIDES, LIMITS, strict=True):
            used = outcomes[0].value("markers", "fixes", side)
            assert used == most if most is not None else used > 5


def test_verdicts() -> None:
    def verdict(holds: int) -> str:
        answers = (True,) * holds + (False,) * (20 - holds)
        return Finding("t", "q", answers, "p", "h").verdict

    assert [verdict(n) for n in (20, 16, 15, 5, 4, 0)] == [
        "holds",
        "holds",
        "depends on the seed",
        "depends on the seed",
        "does not hold",
        "does not hold",
    ]
