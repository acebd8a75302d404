"""A recording that is killed, or loses its power, lacks the frames of its last second at most."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from recorder.log.parts import group_parts, open_log
from recorder.log.reader import LogReader
from recorder.record import record
from recorder.recover import recover
from recorder.sources.base import CapturedFrame
from recorder.verify.run import verify
from tests.conftest import ROOT
from tests.crash_recorder import RATE_HZ, STAMP
from tests.live_sources import LiveScript, now_frames
from tests.log_helpers import images

KILLS = 50
SECOND_NS = 1_000_000_000


def kill_recorders(folder: Path, count: int, seed: int, *more: str) -> None:
    command = [sys.executable, "-m", "tests.crash_recorder", str(folder), str(count), str(seed)]
    command += more
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
def test_fifty_kills_cost_the_last_second_at_most(tmp_path: Path) -> None:
    kill_recorders(tmp_path, KILLS, seed=11)
    lost_frames, lost_ns = [], []
    for k in range(KILLS):
        path, out = tmp_path / f"{k}.mcap", tmp_path / f"{k}-recovered.mcap"
        given = list(STAMP.iter_unpack(path.with_suffix(".frames").read_bytes()))
        _, killed_ns = STAMP.unpack(path.with_suffix(".killed").read_bytes())
        original = path.read_bytes()
        saved = recover(path, out)
        assert path.read_bytes() == original
        with LogReader(out) as log:
            found = [image.frame_index for image in images(log)]
            assert log.cut_short is None
            assert log.metadata["session_end"]["ended"].startswith("recovered: cut short after")
        # The beginning, without a gap, and all that was given more than a second before the kill.
        assert found == list(range(len(found)))
        assert saved.counts.written == len(found)
        lost = given[len(found) :]
        assert [index for index, _ in lost] == list(range(len(found), len(given)))
        lost_frames.append(len(lost))
        lost_ns.append(killed_ns - lost[0][1] if lost else 0)
        assert lost_ns[-1] <= SECOND_NS, f"log {k}"
        rules = {v.rule: v.level for v in verify([out], decode=False).rules}
        assert {rules[name] for name in ("checksums", "index", "counts")} == {"ok"}
    assert max(lost_frames) <= RATE_HZ
    # They were killed in the middle, not before they began or while nothing was open.
    assert sum(n > 0 for n in lost_frames) > KILLS / 3
    print(
        f"\n{KILLS} kills: at most {max(lost_frames)} frames, {max(lost_ns) / 1e9:.3f} s lost; "
        f"on average {np.mean(lost_frames):.1f} frames, {np.mean(lost_ns) / 1e9:.3f} s"
    )


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
def test_kills_while_parts_change_cost_the_last_second_at_most(tmp_path: Path) -> None:
    kills = 10
    kill_recorders(tmp_path, kills, 5, "0.03")
    changes = 0
    for k in range(kills):
        given = list(STAMP.iter_unpack((tmp_path / f"{k}.frames").read_bytes()))
        _, killed_ns = STAMP.unpack((tmp_path / f"{k}.killed").read_bytes())
        (parts,) = group_parts(sorted(tmp_path.glob(f"{k}-*.mcap")))
        changes += len(parts) - 1
        whole = tmp_path / f"saved-{k}"
        whole.mkdir()
        saved = [whole / path.name for path in parts]
        for path, out in zip(parts, saved, strict=True):
            recover(path, out)
        with open_log(saved) as log:
            found = [image.frame_index for image in images(log)]
        assert found == list(range(len(found)))
        if len(found) < len(given):
            assert killed_ns - given[len(found)][1] <= SECOND_NS, f"recording {k}"
        rules = {v.rule: v.level for v in verify(saved, decode=False).rules}
        assert {rules[name] for name in ("parts", "checksums", "index", "counts")} == {"ok"}
    assert changes > 10 * kills


def test_a_power_loss_costs_the_last_second_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is on the disk is what was in the file when the last sync that ended began."""
    path, cut = tmp_path / "log.mcap", tmp_path / "cut.mcap"
    synced: list[tuple[int, int]] = []
    given: list[int] = []

    def slow_sync(number: int) -> None:
        size = os.fstat(number).st_size
        time.sleep(0.15)
        synced.append((time.monotonic_ns(), size))

    def note(frame: CapturedFrame) -> None:
        given.append(time.monotonic_ns())

    monkeypatch.setattr("recorder.log.log_file.fdatasync", slow_sync)
    source = LiveScript(now_frames(200, size=20_000), rate_hz=RATE_HZ, on_frame=note, stays=True)
    record(source, path, duration_s=5.0)
    data = path.read_bytes()
    rng = np.random.default_rng(3)
    lost_ns = []
    for off_ns in rng.integers(given[0] + SECOND_NS, given[0] + 5 * SECOND_NS, 40).tolist():
        sizes = [size for ended_ns, size in synced if ended_ns <= off_ns]
        cut.write_bytes(data[: sizes[-1]])
        with LogReader(cut) as log:
            found = len(images(log))
        before = [stamp_ns for stamp_ns in given if stamp_ns <= off_ns]
        lost_ns.append(off_ns - before[found] if found < len(before) else 0)
    assert max(lost_ns) <= SECOND_NS
    assert sum(ns > 0 for ns in lost_ns) > 10
    # Twice a second, not with every chunk.
    assert 5 <= len(synced) <= 11


_REPLACING = """
import sys
from pathlib import Path
from recorder.record import record
from tests.live_sources import LiveScript, now_frames
record(LiveScript(now_frames(), rate_hz=100), Path(sys.argv[1]), force=True)
"""


def test_a_killed_recorder_leaves_the_log_that_it_was_to_replace(tmp_path: Path) -> None:
    path, part = tmp_path / "log.mcap", tmp_path / "log.mcap.part"
    record(LiveScript(now_frames(5)), path)
    old = path.read_bytes()
    recorder = subprocess.Popen([sys.executable, "-c", _REPLACING, str(path)], cwd=ROOT)
    until = time.monotonic() + 20
    while (not part.exists() or part.stat().st_size < 60_000) and time.monotonic() < until:
        time.sleep(0.02)
    recorder.send_signal(signal.SIGKILL)
    recorder.wait(20)
    assert path.read_bytes() == old
    assert recover(part, tmp_path / "new.mcap").counts.written > 10
    # The next one keeps what can still be recovered.
    record(LiveScript(now_frames(7)), path, force=True)
    with LogReader(path) as log:
        assert len(images(log)) == 7
    assert part.exists()
