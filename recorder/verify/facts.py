"""What the rules look at, gathered in one pass over a log."""

from __future__ import annotations

from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorder.bench.marks import Mark, MarkReader, is_mark
from recorder.image_decoding import flaw
from recorder.image_header import image_fault, image_size
from recorder.log import ending, topics
from recorder.log.counts import said_counts
from recorder.log.damage import Damage
from recorder.log.mcap_records import checksum_problem, index_problem
from recorder.log.parts import open_log, part_number
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent, LogImage
from recorder.log.writer import RECORDER
from recorder.verify.pace import Pace, pace_of

_THREADS = 2


@dataclass(frozen=True, eq=False)
class PartFacts:
    """One file.

    Attributes:
        checksum: what is wrong where no damage was found, in words.
        index: what is wrong with its index of chunks, in words.
        indexed_images: images that its statistics count; None where it has none.
        end: its `session_end`; None without one.
        said: the counts in there.
        lost_camera: the error that came behind the last image, such as a lost connection.
    """

    path: Path
    number: int
    cut_short: str | None
    damage: tuple[Damage, ...]
    checksum: str | None
    index: str | None
    indexed_images: int | None
    end: dict[str, str] | None
    said: dict[str, int]
    images: int
    events: int
    lost_camera: str | None


@dataclass(eq=False)
class Facts:
    """A recording: one log, or its parts in their order.

    Attributes:
        log: to ask for calibration, map and truth.
        indices, timestamps_ns, arrivals_ns: (N,) of all images.
        sizes: how many images there are of each width and height.
        faults: frame number and what is wrong with the image, of those that are not whole.
        cut: how many of these a recorder notices: from the header or the end.
        mark_lines: capture and text of each event that is about a waypoint.
        decoded: whether images were looked into.
    """

    log: LogReader
    parts: tuple[PartFacts, ...]
    indices: NDArray[np.int64]
    timestamps_ns: NDArray[np.int64]
    arrivals_ns: NDArray[np.int64]
    sizes: Counter[tuple[int, int]]
    faults: list[tuple[int, str]]
    cut: int
    mark_lines: list[tuple[int, str]]
    exact: int
    live: bool
    decoded: bool

    @property
    def where(self) -> str:
        """The names of the files."""
        names = [part.path.name for part in self.parts]
        return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"

    def said(self, name: str) -> int | None:
        """A count of all parts together; None where one does not say it."""
        values = [part.said.get(name) for part in self.parts]
        known = [value for value in values if value is not None]
        return sum(known) if len(known) == len(values) else None

    @property
    def image_size(self) -> tuple[int, int] | None:
        """Width and height of most images; None where no header could be read."""
        return self.sizes.most_common(1)[0][0] if self.sizes else None

    @property
    def camera_rate_hz(self) -> float | None:
        """What a camera under /dev was set to. The rates of network cameras are often made up."""
        session = self.log.metadata.get(topics.SESSION, {})
        if session.get("source.kind") != "v4l2":
            return None
        with suppress(KeyError, ValueError, ZeroDivisionError):
            return float(Fraction(session["source.rate_hz"])) or None
        return None

    @property
    def unseen(self) -> NDArray[np.int64]:
        """(P,) how many of the parts up to each follow one that is not here."""
        before = [0, *(part.number for part in self.parts[:-1])]
        return np.cumsum([part.number - b != 1 for part, b in zip(self.parts, before, strict=True)])

    @property
    def all_here(self) -> bool:
        """Whether no part is missing, before, between or behind those that are here."""
        goes_on = ending.next_part((self.parts[-1].end or {}).get("ended", ""))
        return goes_on is None and not self.unseen.any()

    @property
    def adjoin(self) -> NDArray[np.bool_]:
        """(N - 1,) whether no missing part is between an image and the next."""
        before = np.repeat(self.unseen, [part.images for part in self.parts])
        return np.equal(before[1:], before[:-1])

    @cached_property
    def pace(self) -> Pace | None:
        """How captures follow one another; None with too few frames to tell."""
        return pace_of(self.indices, self.timestamps_ns, self.adjoin)

    @cached_property
    def marks(self) -> tuple[Mark, ...]:
        """Of waypoints, by who recorded it."""
        reader = MarkReader(self.log.start_ns or 0)
        for timestamp_ns, text in self.mark_lines:
            reader.add(timestamp_ns, text)
        return reader.marks

    @property
    def seconds(self) -> NDArray[np.float64]:
        """(N,) captures, in seconds of the log."""
        start_ns = self.log.start_ns or 0
        return np.asarray((self.timestamps_ns - start_ns) / 1e9)


@dataclass
class _Seen:
    indices: array[int] = field(default_factory=lambda: array("q"))
    timestamps_ns: array[int] = field(default_factory=lambda: array("q"))
    arrivals_ns: array[int] = field(default_factory=lambda: array("q"))
    sizes: Counter[tuple[int, int]] = field(default_factory=Counter)
    faults: list[tuple[int, str]] = field(default_factory=list)
    cut: int = 0
    mark_lines: list[tuple[int, str]] = field(default_factory=list)
    exact: int = 0


def gather(
    paths: Sequence[Path], *, decode: bool = True, on_image: Callable[[], object] = lambda: None
) -> Facts:
    """Read the parts of one recording.

    Args:
        paths: in the order of the parts.
        decode: also decode every image.
        on_image: called for each, to show progress.

    Raises:
        InputError: one of them is not a log.
    """
    seen = _Seen()
    with _decoder(decode, seen) as check:
        parts = [_read(path, seen, check, on_image) for path in paths]
    log = open_log(paths)
    return Facts(
        log=log,
        parts=tuple(parts),
        indices=np.array(seen.indices, dtype=np.int64),
        timestamps_ns=np.array(seen.timestamps_ns, dtype=np.int64),
        arrivals_ns=np.array(seen.arrivals_ns, dtype=np.int64),
        sizes=seen.sizes,
        faults=sorted(seen.faults),
        cut=seen.cut,
        mark_lines=seen.mark_lines,
        exact=seen.exact,
        live=topics.LIVE in log.metadata.get(topics.SESSION, {}),
        decoded=decode,
    )


def _read(
    path: Path, seen: _Seen, check: Callable[[LogImage], None], on_image: Callable[[], object]
) -> PartFacts:
    images = events = 0
    lost_camera: str | None = None
    reader = LogReader(path)
    for record in reader.records():
        if isinstance(record, ExactPose):
            seen.exact += 1
        elif isinstance(record, LogEvent):
            events += 1
            if is_mark(record.message):
                seen.mark_lines.append((record.timestamp_ns, record.message))
            if record.level == "error" and record.name == RECORDER:
                lost_camera = lost_camera or record.message
        else:
            images += 1
            lost_camera = None
            seen.indices.append(record.frame_index)
            seen.timestamps_ns.append(record.timestamp_ns)
            seen.arrivals_ns.append(record.arrival_ns)
            if (size := image_size(record.data)) is not None:
                seen.sizes[size] += 1
            check(record)
            on_image()
    end = reader.metadata.get(topics.SESSION_END)
    with path.open("rb") as file:
        index = index_problem(file)
        whole = not (reader.damage or reader.cut_short)
        checksum = checksum_problem(file) if whole else None
    return PartFacts(
        path=path,
        number=part_number(reader),
        cut_short=reader.cut_short,
        damage=reader.damage,
        checksum=checksum,
        index=index,
        indexed_images=reader.image_count(),
        end=None if end is None else dict(end),
        said=said_counts(end or {}),
        images=images,
        events=events,
        lost_camera=lost_camera,
    )


@contextmanager
def _decoder(decode: bool, seen: _Seen) -> Iterator[Callable[[LogImage], None]]:
    """What is to be called with each image; the faults are complete when the block ends."""
    waiting: deque[tuple[int, Future[str | None]]] = deque()

    def collect(at_most: int) -> None:
        while len(waiting) > at_most:
            index, looked = waiting.popleft()
            if (fault := looked.result()) is not None:
                seen.faults.append((index, fault))

    with ThreadPoolExecutor(_THREADS, thread_name_prefix="decode") as pool:

        def check(image: LogImage) -> None:
            fault = image_fault(image.data, image.format)
            if fault is not None:
                seen.cut += 1
                seen.faults.append((image.frame_index, fault))
            elif decode:
                looked = pool.submit(flaw, image.data, image.format)
                waiting.append((image.frame_index, looked))
                collect(4 * _THREADS)

        yield check
        collect(0)
