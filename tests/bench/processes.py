"""What a command takes while it runs: memory and processor, its own and its children's."""

from __future__ import annotations

import os
import resource
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PAGE_MB = resource.getpagesize() / 1e6


@dataclass(frozen=True)
class Sample:
    """One look.

    Attributes:
        rss_mb: of the command's own process.
        child_mb: of the largest of its children.
        cpu_s: of its own process since its start.
        children_cpu_s: of all its children, also those that have ended.
    """

    time_ns: int
    rss_mb: float
    child_mb: float
    cpu_s: float
    children_cpu_s: float


@dataclass(frozen=True)
class Watched:
    """A command that has succeeded."""

    stdout: str
    samples: list[Sample]

    def between(self, first_ns: int, last_ns: int) -> list[Sample]:
        """The samples of a time; both ends count."""
        return [sample for sample in self.samples if first_ns <= sample.time_ns <= last_ns]


def watch(command: Sequence[str], *, every_s: float = 0.2) -> Watched:
    """Runs a command to its end.

    Raises:
        RuntimeError: it failed.
    """
    samples: list[Sample] = []
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while True:
            try:
                stdout, stderr = process.communicate(timeout=every_s)
                break
            except subprocess.TimeoutExpired:
                samples.append(_look(process.pid))
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)}: {stderr[-2000:]}")
    return Watched(stdout, samples)


class _Process(NamedTuple):
    parent: int
    cpu_s: float
    reaped_cpu_s: float
    rss_mb: float


def _look(pid: int) -> Sample:
    own = _read(Path(f"/proc/{pid}"))
    children: list[_Process] = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(FileNotFoundError, ProcessLookupError):
            process = _read(folder)
            if process.parent == pid:
                children.append(process)
    return Sample(
        time.time_ns(),
        own.rss_mb,
        max((child.rss_mb for child in children), default=0.0),
        own.cpu_s,
        own.reaped_cpu_s + sum(child.cpu_s for child in children),
    )


def _read(folder: Path) -> _Process:
    # Behind the name, which may hold anything: state, parent, ...; see proc(5).
    fields = (folder / "stat").read_text().rpartition(")")[2].split()
    user, system, reaped_user, reaped_system = (int(v) / _TICKS_PER_S for v in fields[11:15])
    return _Process(
        int(fields[1]), user + system, reaped_user + reaped_system, int(fields[21]) * _PAGE_MB
    )
