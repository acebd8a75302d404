"""Long drives: few chunks, thinned lines, bounded samples."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from replay.viewer import columns, scene, style
from replay.viewer.columns import ColumnBuffer
from replay.viewer.drive import WholeDrive, levelled
from replay.viewer.extent import InnovationLimit, markers_in_view, without_outliers
from replay.viewer.output import RecordingFile
from replay.viewer.thinning import Thinned
from tests.rrd_files import chunks, rows, static


def test_rows_come_in_large_chunks(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    buffer = ColumnBuffer(file.stream)
    n = 3000
    for i in range(n):
        buffer.at(i, i)
        buffer.add("/value", columns.scalars, float(i))
    buffer.flush()
    file.close()
    sizes = [chunk.num_rows for chunk in chunks(tmp_path / "a.rrd", "/value")]
    assert sum(sizes) == n
    assert min(sizes[:-1]) >= 512
    found = rows(tmp_path / "a.rrd", "/value", "Scalars:scalars")
    assert found == {i: [float(i)] for i in range(n)}


def test_images_come_in_large_chunks_however_slow_the_frames(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    data = np.random.default_rng(0).bytes(1 << 16)
    for i in range(100):
        scene.set_time(file.stream, i, i)
        scene.log_image(file.stream, data, "jpeg")
        time.sleep(0.008)
    file.close()
    sizes = [chunk.num_rows for chunk in chunks(tmp_path / "a.rrd", style.IMAGE)]
    assert sum(sizes) == 100
    assert len(sizes) <= 3


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 16, 17, 31, 100, 1000])
def test_thinned_rows_are_few_even_and_reach_the_end(count: int) -> None:
    thinned = Thinned(2, most=8)
    for i in range(count):
        thinned.add(float(i), -float(i))
    kept = thinned.rows()
    assert len(kept) <= 9
    np.testing.assert_array_equal(kept[:, 1], -kept[:, 0])
    if count:
        assert (kept[0, 0], kept[-1, 0]) == (0, count - 1)
        steps = np.diff(kept[:, 0])
        assert len(set(steps[:-1])) <= 1
        assert (steps > 0).all()
        assert steps.max(initial=0) <= max(1, count / 3)
    if count < 8:
        np.testing.assert_array_equal(kept[:, 0], np.arange(count))


def test_whole_drive_is_drawn_with_few_points(tmp_path: Path) -> None:
    drive = WholeDrive(["min"])
    n = 50_000
    for i in range(n):
        position = np.array([i * 1e-3, 0.5, 1.0])
        drive.add_fix(position)
        drive.add_rejected(position)
        drive.add_exact(position)
        drive.add_track("min", position[:2])
    file = RecordingFile(tmp_path / "a.rrd", "id", "a")
    paths = style.ResultPaths("r")
    drive.log(file.stream, paths, style.tracker_looks(["min"]), None, 1.0)
    file.close()
    for entity, component in (
        (f"{paths.tracker('min')}/path", "LineStrips3D:strips"),
        (style.TRUTH_EXACT, "LineStrips3D:strips"),
    ):
        (line,) = static(tmp_path / "a.rrd", entity, component)
        assert 5_000 <= len(line) <= 20_001
        np.testing.assert_allclose(line[-1], [(n - 1) * 1e-3, 0.5, 1.0], rtol=1e-6)
    for name in ("ok", "rejected"):
        points = static(tmp_path / "a.rrd", f"{paths.fixes}/{name}", "Points3D:positions")
        assert 5_000 <= len(points) <= 20_001


def test_innovation_limit_needs_only_a_sample() -> None:
    rng = np.random.default_rng(5)
    limit = InnovationLimit()
    innovations = rng.normal(0.0, 0.1, (60_000, 2))
    for innovation in innovations:
        limit.add(innovation, np.array([1e-4, 1e-4]))
    expected = 1.2 * np.percentile(np.abs(innovations).max(axis=1), 98)
    assert limit.value() == pytest.approx(expected, rel=0.02)
    assert len(limit._frames.rows()) <= 20_001
    assert InnovationLimit().value() == 0.0


def test_a_track_is_level_unless_the_camera_is_lifted() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, 200)
    track = np.stack([np.linspace(0, 2, 200), np.zeros(200), 0.3 + noise], axis=1)
    level = levelled(track, radius_m=1.0)
    assert set(level[:, 2]) == {np.median(track[:, 2])}
    np.testing.assert_array_equal(level[:, :2], track[:, :2])
    track[100:, 2] += 1.0
    np.testing.assert_array_equal(levelled(track, radius_m=1.0), track)
    assert levelled(np.empty((0, 3)), 1.0).shape == (0, 3)


def test_framing_follows_the_drive() -> None:
    fixes = np.zeros((100, 3))
    fixes[50] = (40.0, -30.0, 2.0)
    assert np.abs(without_outliers(fixes)).max() < 1.0
    corners = np.array([[-4.0, 0.0, 2.5], [6.0, 2.0, 2.5]])
    driven = np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 0.0]])
    seen = markers_in_view(corners, driven)
    np.testing.assert_array_equal(seen[:, 2], corners[:, 2])
    # About the middle of the drive, at x = 1.
    assert seen[0, 0] - 1.0 == pytest.approx(-(seen[1, 0] - 1.0))
    assert -4.0 < seen[0, 0] < 0.0
    np.testing.assert_array_equal(markers_in_view(corners, np.empty((0, 3))), corners)
