"""The paper's experiments: its numbers as printed, noise like the detector's, a small run whole."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from analysis.paper.configuration_two import Drive, figures
from analysis.paper.corner_noise import NoisyCorners, jittered, measure
from analysis.paper.experiments import Experiments, run, ticks
from analysis.paper.findings import Finding, all_findings
from analysis.paper.page import write_page
from analysis.paper.references import COUNT, PLACEMENT_HIGH, PLACEMENT_LOW
from pipeline.detection import ArucoDetection
from pipeline.geometry import Array
from pipeline.pose import RansacIterative
from pipeline.variance import PAPER_TABLE
from recorder.files.truth_file import TruthPath
from recorder.simulation.quads import marker_quads
from recorder.simulation.renderer import Renderer
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
    poses = jittered(worlds.looking_up(0.1, 0.05), 12, seed=3)
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


def test_track_figures_by_hand() -> None:
    """A track 3 cm beside a straight drive, with one kink."""
    time_s = np.linspace(0.0, 5.9, 60)
    exact: Array = np.column_stack([0.1 * time_s, np.zeros(60)])
    track: Array = exact.copy()
    track[:, 1] += 0.03
    track[40, 1] += 0.01
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [0.0, 2.0]])
    nis = np.full(60, 2.0)
    drive = Drive(
        time_s,
        exact,
        np.zeros(60),
        exact,
        {"a": track},
        {"a": nis},
        TruthPath(corners, True, 0.035),
    )
    found = figures(drive, "a")
    assert found.rmse_m == pytest.approx(np.sqrt((59 * 0.03**2 + 0.04**2) / 60))
    assert found.in_band == pytest.approx(59 / 60)
    # The kink gives second differences of 1, -2 and 1 cm in 0.1 s, of 38 from 2 s on.
    assert found.acceleration_mps2 == pytest.approx(np.sqrt(6 * 1.0**2 / 38))
    assert found.mean_nis == 2.0


@pytest.fixture(scope="module")
def runs() -> Experiments:
    ticked = []
    found = run(2, lambda: ticked.append(1))
    assert len(ticked) == ticks(2)
    return found


@pytest.mark.bench
def test_two_seeds_make_a_whole_page(runs: Experiments, tmp_path: Path) -> None:
    write_page(runs, tmp_path / "paper.md")
    text = (tmp_path / "paper.md").read_text()
    assert text.count("\n### ") >= 14 + 8 + 4
    assert "nan" not in text
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (tmp_path / target).stat().st_size > 10_000
    titles = re.findall(r"\]\(#([^)]+)\)", text)
    assert len(titles) == len(all_findings(runs))


def test_verdicts() -> None:
    def verdict(holds: int) -> str:
        answers = (True,) * holds + (False,) * (20 - holds)
        return Finding("t", "q", answers, "h").verdict

    assert [verdict(n) for n in (20, 16, 15, 5, 4, 0)] == [
        "holds",
        "holds",
        "depends on the seed",
        "depends on the seed",
        "does not hold",
        "does not hold",
    ]
