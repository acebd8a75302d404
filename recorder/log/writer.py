"""Writes a log."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.records import Channel, Message, Schema

from recorder.errors import InputError
from recorder.image_header import read_header
from recorder.interrupts import uninterrupted
from recorder.log import ending, messages, topics
from recorder.log.derived import DueTruth, Known, static_messages
from recorder.log.log_file import DiskFullError, RawFile
from recorder.log.mcap_output import McapOutput
from recorder.sources.base import CapturedFrame

__all__ = ["DiskFullError", "LogWriter"]


class LogWriter:
    """One log from its first frame to its last; use it in a `with` block.

    However the block ends, the log gets its index and a record of how it ended; an exception
    passes on. Frames go straight into `path`, so that a recording that is killed is found where it
    was expected, readable up to its last chunk. Only when `path` exists and `force` is given do
    they go into `path` with `.part` added, which takes the place of `path` at the end: until then
    the old log is the better one.

    Attributes:
        frames_written: frames accepted so far.
        frames_dropped: gaps in the frame numbers, and losses the source announced.
    """

    def __init__(
        self,
        path: Path,
        *,
        attachments: Mapping[str, bytes],
        session: Mapping[str, str],
        force: bool = False,
        started_ns: int = 0,
        open_raw: Callable[[Path], RawFile] | None = None,
    ) -> None:
        """Opens the log and writes attachments and session.

        Args:
            attachments: name and exact bytes; those named `camera.yaml`, `map.yaml`, `truth.*` are
                checked, and shown on the topics for viewers.
            session: what goes into the metadata of that name.
            started_ns: time of the attachments; 0 keeps recordings of one file identical.
            open_raw: makes the unbuffered file.

        Raises:
            InputError: the file exists, cannot be made, or an attachment is malformed.
        """
        self._known = Known.parse(attachments)
        self._due_truth = DueTruth(self._known.truth)
        self._image_size: tuple[int, int] | None = None
        if self._known.camera is not None:
            self._image_size = self._known.camera.image_size
        self._begun = False
        self._last_index: int | None = None
        self._announced_dropped = 0
        self._closed = False
        self._discarded = False
        self._end: dict[str, str] = {}
        self._events_written = 0
        self.frames_written = 0
        self.frames_dropped = 0
        self.path = path
        self._target = _target(path, force)
        raw = _open(open_raw or _open_raw, self._target)
        try:
            self._output = McapOutput(raw, path.parent)
            for name, data in attachments.items():
                self._output.add_attachment(started_ns, name, _media_type(name), data)
            self._output.add_metadata(topics.SESSION, {"log_format": topics.LOG_FORMAT, **session})
            self._check_space()
        except BaseException as error:
            raw.close()
            self._target.unlink(missing_ok=True)
            if isinstance(error, DiskFullError):
                raise InputError(path, "expected some space, found a full disk") from error
            raise

    @property
    def bytes_written(self) -> int:
        """The size of the file so far."""
        return self._output.bytes_written

    def write_frame(self, frame: CapturedFrame) -> None:
        """One image and, where it is known, the camera's exact pose.

        Raises:
            InputError: its size is not the calibration's, or not that of the frames before.
            DiskFullError: there is space for the end of the log, but no more for frames.
            ValueError: frame numbers that do not increase, or a time before 1970.
        """
        if not 0 <= frame.frame_index < 2**32 or min(frame.timestamp_ns, frame.arrival_ns) < 0:
            raise ValueError(
                f"expected a frame number of 32 bits and times since 1970, found "
                f"{frame.frame_index}, {frame.timestamp_ns}, {frame.arrival_ns}"
            )
        if self._last_index is not None and frame.frame_index <= self._last_index:
            raise ValueError(
                f"expected a frame number above {self._last_index}, found {frame.frame_index}"
            )
        readable = self._check_size(frame)
        with uninterrupted():
            self._begin_image(frame.frame_index, frame.timestamp_ns, frame.arrival_ns)
            self._count_gap(frame)
            if not readable:
                text = f"frame {frame.frame_index} is not a readable {frame.format} image"
                self._event(frame.timestamp_ns, frame.arrival_ns, "warning", text)
            image = messages.to_image(frame.timestamp_ns, frame.data, frame.format)
            stamps = (frame.arrival_ns, frame.timestamp_ns, frame.frame_index)
            self._output.write(topics.IMAGE, image, *stamps)
            self._last_index = frame.frame_index
            self.frames_written += 1
            if frame.T_map_camera is not None:
                pose = messages.to_pose_in_frame(
                    frame.timestamp_ns, self._known.map_frame, frame.T_map_camera
                )
                self._output.write(topics.TRUTH_EXACT, pose, *stamps)
        self._check_space()

    def write_event(
        self,
        timestamp_ns: int,
        level: str,
        message: str,
        *,
        name: str = "recorder",
        arrival_ns: int | None = None,
        dropped: int = 0,
    ) -> None:
        """Something that happened; `dropped` announces frames that are lost with it.

        Raises:
            ValueError: a level that is not debug, info, warning, error or fatal.
            DiskFullError: as `write_frame`.
        """
        arrival_ns = timestamp_ns if arrival_ns is None else arrival_ns
        with uninterrupted():
            self._event(timestamp_ns, arrival_ns, level, message, name)
            self._announced_dropped += dropped
        self._check_space()

    def copy(self, schema: Schema | None, channel: Channel, message: Message) -> None:
        """A message of another log as it is; images bring the topics for viewers with them."""
        with uninterrupted():
            if channel.topic == topics.IMAGE:
                self._begin_image(message.sequence, message.publish_time, message.log_time)
            self._output.copy(schema, channel, message)
            self.frames_written += channel.topic == topics.IMAGE
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
        """Write the end of the log, which is then complete; a second call does nothing."""
        with uninterrupted():
            if self._closed:
                return
            self._closed = True
            try:
                if not self._discarded:
                    self._finish()
            finally:
                self._output.close()
                if self._discarded:
                    self._target.unlink(missing_ok=True)
                elif self._target != self.path:
                    os.replace(self._target, self.path)

    def _finish(self) -> None:
        if not self._begun and not self._output.full:
            self._begin(0, 0)
        self.frames_dropped += self._announced_dropped
        end = {
            "frames_written": str(self.frames_written),
            "frames_dropped": str(self.frames_dropped),
            "events": str(self._events_written),
            "ended": ending.COMPLETE,
        }
        self._output.finish(topics.SESSION_END, {**end, **self._end})

    def _check_size(self, frame: CapturedFrame) -> bool:
        """Whether the image can be read at all; a wrong size is an error."""
        header = read_header(frame.data)
        if header is None or header.format != frame.format:
            return False
        size = (header.width_px, header.height_px)
        if self._image_size is None:
            self._image_size = size
        if size != self._image_size:
            by = "the calibration" if self._known.camera is not None else "the frames before"
            raise InputError(
                self.path,
                f"expected images of {self._image_size[0]}x{self._image_size[1]} as {by}, "
                f"found {size[0]}x{size[1]}",
                f"frame {frame.frame_index}",
            )
        return True

    def _count_gap(self, frame: CapturedFrame) -> None:
        gap = 0 if self._last_index is None else frame.frame_index - self._last_index - 1
        if gap > self._announced_dropped:
            lost = f"{gap} frames lost" if gap > 1 else "1 frame lost"
            text = f"{lost} before frame {frame.frame_index}"
            self._event(frame.timestamp_ns, frame.arrival_ns, "warning", text)
        self.frames_dropped += max(gap, self._announced_dropped)
        self._announced_dropped = 0

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
        self, timestamp_ns: int, arrival_ns: int, level: str, text: str, name: str = "recorder"
    ) -> None:
        message = messages.to_event(timestamp_ns, level, text, name)
        self._output.write(topics.EVENTS, message, arrival_ns, timestamp_ns)
        self._events_written += 1

    def _check_space(self) -> None:
        if self._output.full:
            raise DiskFullError


def _target(path: Path, force: bool) -> Path:
    """The file to write into."""
    if not path.exists():
        return path
    if path.is_dir():
        raise InputError(path, "expected a file, found a folder")
    if not force:
        raise InputError(path, "expected a new file, found one that exists (--force replaces it)")
    return path.with_name(path.name + ".part")


def _open(open_raw: Callable[[Path], RawFile], path: Path) -> RawFile:
    try:
        return open_raw(path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(path, f"expected a file that can be written, found: {reason}") from error


def _open_raw(path: Path) -> RawFile:
    mode = "wb" if path.suffix == ".part" else "xb"
    return open(path, mode, buffering=0)


def _media_type(name: str) -> str:
    suffixes = {".yaml": "application/yaml", ".csv": "text/csv"}
    return suffixes.get(Path(name).suffix, "text/plain")
