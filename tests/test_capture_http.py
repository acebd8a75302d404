"""A network camera at its worst, from its socket to the log: what is left of it is counted."""

from __future__ import annotations

import hashlib
from pathlib import Path

from recorder.log.reader import LogEvent, LogReader
from recorder.record import record
from recorder.sources.opening import open_source
from recorder.verify.run import verify
from tests.log_helpers import images
from tests.mjpeg_server import Fault, MjpegServer, Script


def test_every_frame_is_in_the_log_as_it_was_served_or_told_of(tmp_path: Path) -> None:
    faults = {
        20: Fault("corrupt"),
        40: Fault("truncated"),
        60: Fault("empty"),
        80: Fault("stall", 0.5),
        100: Fault("down", 1.0),
        140: Fault("cut"),
    }
    script = Script(count=200, rate_hz=60.0, frame_bytes=20_000, faults=faults)
    path = tmp_path / "log.mcap"
    with MjpegServer(script) as server:
        summary = record(open_source(server.url), path, duration_s=9.0)
        served = server.served()
    with LogReader(path) as log:
        found = [hashlib.sha256(image.data).hexdigest() for image in images(log)]
        events = [r.message for r in log.records() if isinstance(r, LogEvent)]
        end = log.metadata["session_end"]
        assert log.shortfall is None
    assert summary.ended == "complete"
    # Every good frame of the script, in order, without a change.
    good = [s.sha256 for s in served if s.kind == "good"]
    sent = [s.sha256 for s in served if s.kind != "cut"]
    missing = [digest for digest in good if digest not in found]
    # The look at the camera before the recording took some at its start.
    assert good.index(good[-1]) > 190
    assert missing == good[: len(missing)]
    assert len(missing) < 10
    assert [digest for digest in sent if digest in found] == found
    assert end["frames_written"] == str(len(found)) == str(summary.counts.written)
    assert summary.counts.corrupt >= 1
    assert summary.counts.dropped >= 1
    assert any("without its end" in text for text in events)
    assert any("empty" in text for text in events)
    rules = {v.rule: v.level for v in verify([path]).rules}
    assert rules["counts"] == rules["end"] == "ok"
