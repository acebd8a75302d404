"""Logs of any length for benchmarks: a rendered drive, repeated."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from recorder.log.writer import LogWriter
from recorder.sources.base import CapturedFrame
from recorder.sources.opening import open_source


def rendered(scene: str, n_frames: int) -> tuple[dict[str, bytes], list[CapturedFrame]]:
    """The files that a shipped scene tells, and its first frames."""
    source = open_source(scene)
    frames = [f for f in islice(source.frames(), n_frames) if isinstance(f, CapturedFrame)]
    return dict(source.attachments), frames


def write_repeated(
    path: Path, files: dict[str, bytes], frames: list[CapturedFrame], times: int
) -> Path:
    """A log with the frames over and over, at 10 frames/s without a gap."""
    with LogWriter(path, attachments=files, session={"source": "benchmark"}) as writer:
        for i in range(len(frames) * times):
            frame, stamp = frames[i % len(frames)], i * 100_000_000
            writer.write_frame(
                CapturedFrame(i, stamp, stamp, frame.data, frame.format, frame.T_map_camera)
            )
    return path
