"""Writes a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.records import Channel, Message, Schema

from recorder.errors import InputError
from recorder.interrupts import uninterrupted
from recorder.log import ending, messages, topics
from recorder.log.counts import FrameCounts
from recorder.log.derived import DueTruth, Known, static_messages
from recorder.log.journal import FrameJournal
from recorder.log.log_file import DiskFullError, RawFile, sync_folder
from recorder.log.mcap_output import McapOutput
from recorder.log.target import Target
from recorder.sources.base import CapturedFrame

__all__ = ["DiskFullError", "LogWriter"]

RECORDER = "recorder"


class LogWriter:
    """One log from its first frame to its last; use it in a `with` block.

    However the block ends, the log gets its index and a record of how it ended; an exception
    passes on. Frames go straight into `path`, so that a recording that is killed is found where it
    was expected, readable up to its last chunk. Only when `path` exists and `force` is given do
    they go into `path` with `.part` added, which takes the place of `path` at the end: until then
    the old log is the better one, and if an error ends the new one it stays so.

    Attributes:
        counts: of the frames so far.
    """

    def __init__(
        self,
        path: Path,
        *,
        attachments: Mapping[str, bytes],
        session: Mapping[str, str],
        force: bool = False,
        live: bool = False,
        started_ns: int = 0,
        continues: LogWriter | None = None,
        open_raw: Callable[[Path], RawFile] | None = None,
    ) -> None:
        """Opens the log and writes attachments and session.

        Args:
            attachments: name and exact bytes; those named `camera.yaml`, `map.yaml`, `truth.*` are
                checked, and shown on the topics for viewers.
            session: what goes into the metadata of that name.
            live: frames come once: late ones are counted, one of another size is kept as corrupt,
                and the log is on the disk when it is closed.
            started_ns: time of the attachments; 0 keeps recordings of one file identical.
            continues: the part of the same recording before this one.
            open_raw: makes the unbuffered file.

        Raises:
            InputError: the file exists, is being written, cannot be made, or an attachment is
                malformed.
        """
        self._known = Known.parse(attachments)
        self._live = live
        self._begun = False
        self._closed = False
        self._discarded = False
        self._copies = False
        self._end: dict[str, str] = {}
        self._events_written = 0
        self.path = path
        if continues is None:
            said = session.get(topics.RECORDING_START, "")
            start_ns = int(said) if said.isdecimal() else None
            self._due_truth = DueTruth(self._known.truth, start_ns)
            camera = self._known.camera
            size = camera.image_size if camera is not None else None
            self._journal = FrameJournal(live=live, calibrated_size=size)
        else:
            self._due_truth, self._journal = continues._due_truth, continues._journal
        self.counts = FrameCounts()
        self._target = Target(path, force=force, open_raw=open_raw)
        try:
            self._output = McapOutput(self._target.raw, path.parent)
            for name, data in attachments.items():
                self._output.add_attachment(started_ns, name, _media_type(name), data)
            self._output.add_metadata(topics.SESSION, {"log_format": topics.LOG_FORMAT, **session})
            self._check_space()
        except BaseException as error:
            self._target.raw.close()
            self.written_to.unlink(missing_ok=True)
            if isinstance(error, DiskFullError):
                raise InputError(path, "expected some space, found a full disk") from error
            raise
        if live:
            sync_folder(path.parent)

    @property
    def written_to(self) -> Path:
        """The file itself: `path`, or the one beside it."""
        return self._target.written_to

    @property
    def frames_written(self) -> int:
        return self.counts.written

    @property
    def frames_dropped(self) -> int:
        return self.counts.dropped

    @property
    def bytes_written(self) -> int:
        """The size of the file so far."""
        return self._output.bytes_written

    @property
    def bytes_ahead(self) -> int:
        """The size of the file, at most, if the log ended now."""
        return self._output.bytes_ahead

    @property
    def has_open_chunk(self) -> bool:
        """There is something that a kill would lose."""
        return self._output.has_open_chunk

    @property
    def is_in_place(self) -> bool:
        """Nobody removed, moved or replaced the file."""
        return self._output.is_at(self.written_to)

    @property
    def last_stamps(self) -> tuple[int, int]:
        """Capture and arrival of the last frame of the recording; 0 where there was none."""
        return self._journal.last_stamps

    @property
    def passed_ns(self) -> int:
        """From the recording's first capture to the last; at a jump back, no time passes."""
        return self._journal.passed_ns

    @property
    def announced_dropped(self) -> int:
        """Frames known to be lost that are not in `counts` yet."""
        return self._journal.announced

    def take_told(self) -> tuple[str, ...]:
        """The warnings and errors that were written since the last call; from any thread."""
        told = self._journal.told
        return tuple(told.popleft() for _ in range(len(told)))

    def flush(self) -> None:
        """Hand all frames so far to the system: a process that is killed no longer loses them."""
        with uninterrupted():
            self._output.flush()

    def sync(self) -> None:
        """Wait until what was handed to the system is on the disk; from any thread.

        Raises:
            OSError: it could not be put there.
        """
        self._output.sync()

    def write_frame(self, frame: CapturedFrame) -> str | None:
        """One image and, where it is known, the camera's exact pose.

        Returns:
            What shows that the image is corrupt, in a few words; None where nothing does.

        Raises:
            InputError: its size is not the calibration's, or not that of the frames before, and it
                can be had again: it is not of a live source.
            DiskFullError: there is space for the end of the log, but no more for frames.
            ValueError: frame numbers that do not increase, or a time before 1970.
        """
        fault = self._journal.check(frame, self.path)
        with uninterrupted():
            self._begin_image(frame.frame_index, frame.timestamp_ns, frame.arrival_ns)
            for text in self._journal.judge(frame, fault, self.counts):
                self._event(frame.timestamp_ns, frame.arrival_ns, "warning", text)
            image = messages.to_image(frame.timestamp_ns, frame.data, frame.format)
            stamps = (frame.arrival_ns, frame.timestamp_ns, frame.frame_index)
            self._output.write(topics.IMAGE, image, *stamps)
            self.counts.written += 1
            if frame.T_map_camera is not None:
                pose = messages.to_pose_in_frame(
                    frame.timestamp_ns, self._known.map_frame, frame.T_map_camera
                )
                self._output.write(topics.TRUTH_EXACT, pose, *stamps)
        self._check_space()
        return fault

    def count_inspected(self, frame_index: int, timestamp_ns: int, flaw: str | None) -> None:
        """A frame that is in the log was looked into: `flaw` says what is wrong inside it.

        Raises:
            DiskFullError: as `write_frame`.
        """
        self.counts.inspected += 1
        if flaw is None:
            return
        self.counts.corrupt += 1
        arrival_ns = self.last_stamps[1]
        with uninterrupted():
            for text in self._journal.admit(arrival_ns, f"frame {frame_index} is {flaw}"):
                self._event(timestamp_ns, arrival_ns, "warning", text)
        self._check_space()

    def write_event(
        self,
        timestamp_ns: int,
        level: str,
        message: str,
        *,
        name: str = RECORDER,
        arrival_ns: int | None = None,
        dropped: int = 0,
    ) -> None:
        """Something that happened; `dropped` announces frames that are lost with it.

        Of warnings and errors of the recorder itself, and of one kind, five a second are written;
        the others are counted in a later one.

        Raises:
            ValueError: a level that is not debug, info, warning, error or fatal.
            DiskFullError: as `write_frame`.
        """
        arrival_ns = timestamp_ns if arrival_ns is None else arrival_ns
        with uninterrupted():
            limited = name == RECORDER and level in ("warning", "error")
            for text in self._journal.admit(arrival_ns, message) if limited else (message,):
                self._event(timestamp_ns, arrival_ns, level, text, name)
            self._journal.announce(dropped)
        self._check_space()

    def announce_dropped(self, dropped: int) -> None:
        """Frames that are lost, where there is no space to say more about them.

        Where the log has its end already, only `counts` can tell.
        """
        self._journal.announce(dropped)
        if self._closed:
            self.counts.dropped += self._journal.announced
            self._journal.announced = 0

    def copy(self, schema: Schema | None, channel: Channel, message: Message) -> None:
        """A message of another log as it is; images bring the topics for viewers with them."""
        self._copies = True
        with uninterrupted():
            if channel.topic == topics.IMAGE:
                self._begin_image(message.sequence, message.publish_time, message.log_time)
            self._output.copy(schema, channel, message)
            self.counts.written += channel.topic == topics.IMAGE
            self._events_written += channel.topic == topics.EVENTS
        self._check_space()

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """A further metadata record."""
        with uninterrupted():
            self._output.add_metadata(name, values)

    def end_as(self, ended: str, **more: str) -> None:
        """How the log ends when the block does; without a word from anyone it is `complete`."""
        self._end = {"ended": ended, **more}

    def discard(self) -> None:
        """Leave no file behind when the block ends."""
        self._discarded = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None and not self._end:
            self._end = {"ended": ending.after(error)}
        self.close()

    def close(self) -> None:
        """Write the end of the log, which is then complete; a second call does nothing.

        Raises:
            DisplacedError: the log that it was to replace is not there any more, but another one;
                this one is whole in `written_to`.
            InputError: somebody removed the file that was to replace another.
        """
        with uninterrupted():
            if self._closed:
                return
            self._closed = True
            replaces = self._target.is_beside
            whole = False
            try:
                if not self._discarded:
                    self._finish()
                    if self._live or replaces:
                        self._output.sync()
                    failed = ending.failed(self._end.get("ended", ending.COMPLETE))
                    # A copy is whole also where its original is not.
                    whole = self._copies or not failed
            finally:
                # What a failed write took with it was counted when it came.
                lost = self._output.open_messages(topics.IMAGE)
                self.counts.written -= lost
                self.counts.dropped += lost
                ours = self.is_in_place
                self._output.close()
                if self._discarded:
                    if ours:
                        self.written_to.unlink(missing_ok=True)
                elif replaces and whole:
                    self._target.take_place(is_ours=ours)

    def _finish(self) -> None:
        if not self._begun and not self._output.full:
            self._begin(0, 0)
        goes_on = ending.next_part(self._end.get("ended", "")) is not None
        for text in self._journal.end_part(self.counts, goes_on=goes_on):
            if not self._output.full:
                with suppress(DiskFullError):
                    self._event(*self._journal.last_stamps, "warning", text)
        end = {
            **self.counts.as_metadata(),
            "display_dropped": "0",
            "events": str(self._events_written),
            "ended": ending.COMPLETE,
        }
        self._output.finish(topics.SESSION_END, {**end, **self._end})

    def _begin_image(self, frame_index: int, timestamp_ns: int, arrival_ns: int) -> None:
        if not self._begun:
            self._begin(timestamp_ns, arrival_ns)
        for due_ns, pose in self._due_truth(frame_index, timestamp_ns):
            message = messages.to_pose_in_frame(due_ns, self._known.map_frame, pose)
            self._output.write(topics.TRUTH_POSE, message, arrival_ns, due_ns)

    def _begin(self, timestamp_ns: int, arrival_ns: int) -> None:
        self._begun = True
        for topic, message in static_messages(self._known, timestamp_ns):
            self._output.write(topic, message, arrival_ns, timestamp_ns)

    def _event(
        self, timestamp_ns: int, arrival_ns: int, level: str, text: str, name: str = RECORDER
    ) -> None:
        message = messages.to_event(timestamp_ns, level, text, name)
        self._output.write(topics.EVENTS, message, arrival_ns, timestamp_ns)
        self._events_written += 1

    def _check_space(self) -> None:
        if self._output.full:
            raise DiskFullError


def _media_type(name: str) -> str:
    suffixes = {".yaml": "application/yaml", ".csv": "text/csv"}
    return suffixes.get(Path(name).suffix, "text/plain")
