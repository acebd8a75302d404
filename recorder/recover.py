"""What can be saved of a log that was cut short or damaged, as a whole log."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError

from recorder.errors import InputError
from recorder.image_header import image_fault, image_size
from recorder.log import ending, topics
from recorder.log.counts import FrameCounts
from recorder.log.damage import Damage
from recorder.log.frame_checks import FrameChecks
from recorder.log.messages import from_image
from recorder.log.reader import LogReader
from recorder.log.writer import DiskFullError, LogWriter


@dataclass(frozen=True)
class Recovered:
    """What was saved.

    Attributes:
        problem: what was wrong with the log; None where nothing was.
        counts: of the frames that are there; dropped are those whose numbers are missing.
        attachments: names of the files in the log.
        damage: what was left out in the middle.
    """

    log: str
    out: str
    problem: str | None
    counts: FrameCounts
    duration_s: float
    attachments: tuple[str, ...]
    damage: tuple[Damage, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "log": self.log,
            "recovered": self.out,
            "problem": self.problem,
            **{name: int(value) for name, value in self.counts.as_metadata().items()},
            "duration_s": self.duration_s,
            "attachments": list(self.attachments),
            "damage": [vars(piece) for piece in self.damage],
        }


def recover(log: Path, out: Path, *, force: bool = False) -> Recovered:
    """Copy every readable message of `log` into a whole log `out`, with its index and its counts.

    `log` is only read. Of a log that is whole, `out` is a copy that ends as it did.

    Raises:
        InputError: not a log, nothing in it, `out` is `log` or exists, or there is no space.
    """
    if out.exists() and out.samefile(log):
        raise InputError(out, "expected another file than the log, which is left as it is")
    with LogReader(log) as reader:
        camera = reader.camera()
        counts = _Counter(
            live=topics.LIVE in reader.metadata.get(topics.SESSION, {}),
            calibrated_size=camera.image_size if camera is not None else None,
        )
        session = {"source": log.name, **reader.metadata.get(topics.SESSION, {})}
        session.pop("log_format", None)
        shown = set[str]().union(*(topics.SHOWN_ON.get(name, ()) for name in reader.attachments))
        try:
            with LogWriter(
                out, attachments=reader.attachments, session=session, force=force
            ) as writer:
                try:
                    copied = _copy(reader, writer, counts, shown)
                    if not (copied or reader.attachments or reader.metadata):
                        found = reader.cut_short or "nothing in it"
                        raise InputError(log, f"expected something to save, found: {found}")
                    writer.end_as(**_end(reader, counts.counts))
                except BaseException:
                    writer.discard()
                    raise
        except DiskFullError as error:
            raise InputError(out, "expected space for a copy, found a full disk") from error
        return Recovered(
            log=str(log),
            out=str(out),
            problem=_problem(reader),
            counts=counts.counts,
            duration_s=counts.duration_s,
            attachments=tuple(reader.attachments),
            damage=reader.damage,
        )


def _copy(reader: LogReader, writer: LogWriter, counts: _Counter, shown: set[str]) -> int:
    """How many messages there were."""
    copied = 0
    for name, values in reader.other_metadata():
        writer.add_metadata(name, values)
    own = topics.SESSION in reader.metadata
    writer.add_metadata("recovered", {"from": reader.path.name, "sha256": reader.sha256()})
    for schema, channel, message in reader.messages():
        copied += 1
        if channel.topic == topics.IMAGE:
            if not own:
                # A log of another make may leave it at 0.
                message = replace(message, sequence=counts.counts.written)
            try:
                _, data, format = from_image(CompressedImage.FromString(message.data))
            except DecodeError as error:
                problem = "expected foxglove.CompressedImage, found other bytes"
                raise InputError(reader.path, problem, topics.IMAGE) from error
            stamps = (message.publish_time, message.log_time)
            fault = image_fault(data, format) or counts.other_size(image_size(data))
            counts.add(message.sequence, *stamps, fault)
        # What attachments show to viewers is made anew from them.
        if channel.topic not in shown:
            writer.copy(schema, channel, message)
    return copied


class _Counter:
    """Counts frames anew: what a killed recorder counted died with it."""

    def __init__(self, *, live: bool, calibrated_size: tuple[int, int] | None) -> None:
        self._size = calibrated_size
        self._checks = FrameChecks(live=live)
        self.counts = FrameCounts()

    def add(self, index: int, timestamp_ns: int, arrival_ns: int, fault: str | None) -> None:
        verdict = self._checks.add(index, timestamp_ns, arrival_ns)
        counts = self.counts
        counts.written += 1
        counts.dropped += verdict.gap
        counts.late += verdict.late_ns > 0
        counts.stamped_back += verdict.back_ns > 0
        counts.corrupt += fault is not None

    def other_size(self, size: tuple[int, int] | None) -> str | None:
        """That an image is not of the calibration's size, or of that of those before."""
        self._size = self._size or size
        return None if size in (None, self._size) else "of another size"

    @property
    def duration_s(self) -> float:
        return self._checks.passed_ns / 1e9


def _problem(reader: LogReader) -> str | None:
    if reader.cut_short is not None or reader.damage:
        return reader.ending
    return "without its index" if reader.image_count() is None else None


def _end(reader: LogReader, found: FrameCounts) -> dict[str, str]:
    """The last record: as it was, where nothing is wrong; else what is there now."""
    problem = _problem(reader)
    if problem is None:
        return {**reader.metadata.get(topics.SESSION_END, {}), "ended": reader.ending}
    return {"ended": ending.recovered(problem), **found.as_metadata()}
