"""Logs that are parts of one recording, read as one log."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.writer import MCAP0_MAGIC

from recorder.errors import InputError
from recorder.log import topics
from recorder.log.damage import Damage
from recorder.log.reader import LogReader


def part_path(path: Path, part: int) -> Path:
    """`drive-001.mcap` for part 1 of `drive.mcap`."""
    return path.with_name(f"{path.stem}-{part:03}{path.suffix}")


def whole_path(part: Path) -> Path:
    """`drive.mcap` for `drive-001.mcap`; the path itself where its name is not that of a part."""
    stem, _, number = part.stem.rpartition("-")
    return part.with_name(f"{stem}{part.suffix}") if stem and number.isdecimal() else part


def group_parts(
    paths: Sequence[Path], warn: Callable[[str], None] | None = None
) -> list[tuple[Path, ...]]:
    """Parts of one recording together, in their order; other logs alone, where they were given.

    Args:
        warn: told of a part that is left out as nothing is in it: a recorder that is killed while
            it begins one leaves it so.

    Raises:
        InputError: not a log, or a part that is given twice.
    """
    groups: dict[str, dict[int, Path]] = {}
    for position, path in enumerate(paths):
        beside = [p for p in paths if p != path and whole_path(p) == whole_path(path)]
        if beside and _is_unbegun(path):
            if warn is not None:
                warn(f"{path}: left out, a part of a recording with nothing in it")
            continue
        session = LogReader(path).metadata.get(topics.SESSION, {})
        part = session.get(topics.PART, "")
        if not session.get(topics.RECORDING) or not part.isdecimal():
            groups[f"log {position}"] = {0: path}
            continue
        group = groups.setdefault(session[topics.RECORDING], {})
        if int(part) in group:
            other = group[int(part)]
            raise InputError(path, f"expected each part once, found part {part} in {other} too")
        group[int(part)] = path
    return [tuple(group[part] for part in sorted(group)) for group in groups.values()]


def _is_unbegun(path: Path) -> bool:
    """Whether a file with the name of a part was cut before its session was written."""
    if whole_path(path) == path or not path.is_file():
        return False
    if path.stat().st_size < len(MCAP0_MAGIC):
        return True
    log = LogReader(path)
    return topics.SESSION not in log.metadata and log.start_ns is None and not log.image_count()


def open_log(paths: Sequence[Path]) -> LogReader:
    """One log, or the parts of one recording (in their order) as one.

    Raises:
        InputError: not a log.
    """
    return LogReader(paths[0]) if len(paths) == 1 else PartsReader(paths)


class PartsReader(LogReader):
    """The parts of a recording, read one after the other.

    Attachments and session are the first part's; how it ended is the last one's.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        """`paths`: in the order of the parts."""
        super().__init__(paths[0])
        self._further = [LogReader(path) for path in paths[1:]]
        counts = [super().image_count(), *(part.image_count() for part in self._further)]
        known = [n for n in counts if n is not None]
        self._image_count = sum(known) if len(known) == len(counts) else None
        if self.start_ns is None:
            starts = (part.start_ns for part in self._further)
            self.start_ns = next((start for start in starts if start is not None), None)
        self._take_end()

    @property
    def paths(self) -> tuple[Path, ...]:
        return (self.path, *(part.path for part in self._further))

    def sha256(self) -> str:
        """Digest of the parts' digests, in hex."""
        digests = [super().sha256(), *(part.sha256() for part in self._further)]
        return hashlib.sha256("".join(digests).encode()).hexdigest()

    def messages(self) -> Iterator[tuple[Schema | None, Channel, Message]]:
        """Every message of every part."""
        yield from super().messages()
        cut = [self.cut_short]
        damage: list[Damage] = list(self._damage)
        for part in self._further:
            yield from part.messages()
            cut.append(part.cut_short and f"{part.path.name} is {part.cut_short}")
            damage += part.damage
        self.cut_short = "; ".join(filter(None, cut)) or None
        self._damage[:] = damage
        self._take_end()

    @property
    def missing_parts(self) -> str | None:
        """Which parts lie between those that are here, in words; None where none do."""
        here = [part_number(self), *(part_number(part) for part in self._further)]
        gone = [str(n) for n in range(1, max(here)) if n not in here]
        return f"without part {', '.join(gone)} of the recording" if gone else None

    def _take_end(self) -> None:
        end = self._further[-1].metadata.get(topics.SESSION_END)
        if end is None:
            self._metadata.pop(topics.SESSION_END, None)
        else:
            self._metadata[topics.SESSION_END] = dict(end)


def part_number(log: LogReader) -> int:
    """Which part of its recording a log is; 1 for one that is whole."""
    said = log.metadata.get(topics.SESSION, {}).get(topics.PART, "")
    return int(said) if said.isdecimal() else 1
