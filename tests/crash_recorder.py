"""Records with many processes and kills each at a random moment.

`python -m tests.crash_recorder FOLDER COUNT SEED [SPLIT_S]` leaves `K.mcap` or, with SPLIT_S, its
parts, in `K.frames` the number and the time (both 8 bytes, nanoseconds of the monotonic clock) of
each frame that the recorder was given, and in `K.killed` the time of the kill.
"""

from __future__ import annotations

import os
import random
import signal
import struct
import sys
import time
from pathlib import Path

from recorder.capture.parts import SplitLimit
from recorder.record import record
from recorder.sources.base import CapturedFrame
from tests.live_sources import LiveScript, now_frames

STAMP = struct.Struct("<qq")
RATE_HZ = 60.0
_AT_ONCE = 10


def run(path: Path, frames: int | None, split_s: float | None) -> None:
    """Records until it is killed; after `frames` frames nothing comes any more."""
    given = os.open(path.with_suffix(".frames"), os.O_WRONLY | os.O_CREAT)

    def note(frame: CapturedFrame) -> None:
        os.write(given, STAMP.pack(frame.frame_index, time.monotonic_ns()))

    source = LiveScript(now_frames(frames, size=20_000), rate_hz=RATE_HZ, on_frame=note, stays=True)
    split = SplitLimit(seconds=split_s) if split_s is not None else None
    record(source, path, session={"git": "-"}, split=split)


def wait_for_a_frame(given: Path) -> None:
    """A busy machine may take seconds to begin."""
    until_s = time.monotonic() + 30
    while not (given.exists() and given.stat().st_size):
        if time.monotonic() > until_s:
            raise TimeoutError(given)
        time.sleep(0.01)


def main(folder: Path, count: int, seed: int, split_s: float | None = None) -> None:
    rng = random.Random(seed)
    for first in range(0, count, _AT_ONCE):
        running: list[tuple[int, Path]] = []
        for k in range(first, min(first + _AT_ONCE, count)):
            path = folder / f"{k}.mcap"
            # Some fall silent: what came before must not wait for more to come.
            frames = rng.randrange(20, 80) if k % 3 == 0 else None
            pid = os.fork()
            if pid == 0:
                try:
                    run(path, frames, split_s)
                finally:
                    os._exit(0)
            running.append((pid, path))
        for _, path in running:
            wait_for_a_frame(path.with_suffix(".frames"))
        ends = [(time.monotonic() + rng.uniform(0.0, 2.1), *recorder) for recorder in running]
        for end, pid, path in sorted(ends):
            time.sleep(max(end - time.monotonic(), 0))
            killed_ns = time.monotonic_ns()
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            path.with_suffix(".killed").write_bytes(STAMP.pack(0, killed_ns))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), *map(float, sys.argv[4:]))
