"""A live source over a connection that may be lost and come back."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, wait
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from recorder.errors import InputError
from recorder.image_header import image_fault, image_size
from recorder.sources.base import CapturedFrame, SourceEvent

# No first image within this time: there is none.
_LOOK_S = 10.0
# Silence of a connection that counts as its loss.
SILENCE_S = 10.0
_FIRST_PAUSE_S = 0.5
_LONGEST_PAUSE_S = 1.0
_STOP_POLL_S = 0.1


class Received(NamedTuple):
    """What came over a connection for one frame.

    Attributes:
        data: the compressed image as it came, also an empty or a damaged one.
        timestamp_ns: capture by the clock of the connection; None where the frame has no stamp.
        problem: what the connection says is wrong with it, such as `cannot be decoded`; if there
            are no bytes then, the frame is lost.
        note: something to tell beside the image.
    """

    data: bytes
    arrival_ns: int
    timestamp_ns: int | None = None
    format: str = "jpeg"
    problem: str | None = None
    note: str | None = None


class ConnectionLost(Exception):  # noqa: N818 - an outcome, not an error
    """The connection is of no more use; `cut` if it went in the middle of a frame."""

    def __init__(self, reason: str, *, cut: bool = False) -> None:
        super().__init__(reason)
        self.cut = cut


class Connection(Protocol):
    """An open way to a camera."""

    def receive(self) -> Received | None:
        """The next frame; None when there was none for a moment (0.5 s at most).

        Raises:
            ConnectionLost: nothing more will come.
        """
        ...

    def describe(self) -> Mapping[str, str]:
        """What the camera says of itself once a frame was received: `clock`, codec, rate."""
        ...

    def interrupt(self) -> None:
        """From another thread: let `receive` end at once, if it would not by itself."""
        ...

    def close(self) -> None: ...


@dataclass
class _Progress:
    """Where the frames are, across connections; `heard_s`: when the last one came."""

    next_index: int = 0
    last_ns: int = 0
    heard_s: float = 0.0
    clock: str = ""

    @property
    def silent_s(self) -> float:
        return time.monotonic() - self.heard_s


class LiveCamera:
    """Frames from one connection after another, with numbers that go on.

    The numbers are our own, and count what was received: each frame has one, also one that cannot
    be decoded. Frames that a camera takes while it is not connected have none; the event when it is
    back says how long that was.

    Args:
        connect: opens a connection; raises InputError.
        about: for `describe`, beside what the connection says.
        warnings: told once, at the start.

    Raises:
        InputError: no connection, or no image from it.
    """

    def __init__(
        self,
        name: str,
        spec: str,
        connect: Callable[[], Connection],
        about: Mapping[str, str],
        warnings: tuple[str, ...] = (),
    ) -> None:
        self.name = name
        self._spec = spec
        self._connect = connect
        self._warnings = warnings
        self._stopped = threading.Event()
        self._connection: Connection | None = None
        self._progress = _Progress()
        # A look, no more: what is not read from now on would wait, and have the wrong arrival.
        connection = connect()
        try:
            self._image_size = _first_size(connection, spec)
            self._about = {**about, **connection.describe()}
            self._progress.clock = self._about["clock"]
        except ConnectionLost as lost:
            raise InputError(spec, f"expected a first image, found: {lost}") from lost
        finally:
            connection.close()

    def describe(self) -> dict[str, str]:
        width, height = self._image_size
        return {**self._about, "size": f"{width}x{height}"}

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return {}

    @property
    def image_size(self) -> tuple[int, int]:
        return self._image_size

    def frame_count(self) -> int | None:
        return None

    def preparation(self) -> str | None:
        return "\n".join(self._warnings) or None

    def stop(self) -> None:
        """From another thread: let `frames` end, within a second."""
        self._stopped.set()
        if connection := self._connection:
            connection.interrupt()

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        """Until `stop`; a connection that is lost is tried again for as long as it takes."""
        self._progress.last_ns = time.time_ns()
        for text in self._warnings:
            yield self._event("warning", text)
        pause_s = _FIRST_PAUSE_S
        self._progress.heard_s = time.monotonic()
        is_down = False
        while not self._stopped.is_set():
            try:
                connection = self._opened()
            except InputError as error:
                if not is_down:
                    is_down = True
                    yield self._event("error", f"no connection: {error.problem}", connected=False)
                self._stopped.wait(pause_s)
                pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
                continue
            if connection is None:
                return
            try:
                for item in self._received(connection):
                    if is_down:
                        gone_s = self._progress.silent_s
                        yield self._event(
                            "warning", f"connected again after {gone_s:.1f} s", connected=True
                        )
                        is_down, pause_s = False, _FIRST_PAUSE_S
                    self._progress.heard_s = time.monotonic()
                    yield item
            except ConnectionLost as lost:
                if self._stopped.is_set():
                    return
                # Lost again before anything came: told already.
                if not is_down or lost.cut:
                    yield self._lost(lost)
                is_down = True
            finally:
                self._connection = None
                connection.close()
            # Not before it is closed: a device that is held open comes back under another name.
            self._stopped.wait(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)

    def _lost(self, lost: ConnectionLost) -> SourceEvent:
        number = self._progress.next_index
        if lost.cut:
            self._progress.next_index += 1
            return self._event(
                "error",
                f"connection lost in the middle of frame {number}: {lost}",
                dropped=1,
                connected=False,
            )
        place = f"after frame {number - 1}" if number else "before the first frame"
        return self._event("error", f"connection lost {place}: {lost}", connected=False)

    def _received(self, connection: Connection) -> Iterator[CapturedFrame | SourceEvent]:
        """What comes over one connection.

        Raises:
            ConnectionLost: it is of no more use.
        """
        heard_s = time.monotonic()
        while not self._stopped.is_set():
            received = connection.receive()
            if received is not None:
                heard_s = time.monotonic()
                if (clock := connection.describe()["clock"]) != self._progress.clock:
                    yield self._event("warning", f"capture times are now from: {clock}")
                    self._progress.clock = clock
                yield from self._numbered(received)
            elif time.monotonic() - heard_s > SILENCE_S:
                raise ConnectionLost(f"nothing for {SILENCE_S:g} s")

    def _numbered(self, received: Received) -> Iterator[CapturedFrame | SourceEvent]:
        progress = self._progress
        index = progress.next_index
        progress.next_index += 1
        # A stamp of 0 or below is none: a camera before its clock is set, a stream before its zero.
        stamp_ns = received.timestamp_ns or 0
        timestamp_ns = stamp_ns if stamp_ns > 0 else received.arrival_ns
        progress.last_ns = timestamp_ns
        if received.note:
            yield SourceEvent(timestamp_ns, "warning", f"before frame {index}: {received.note}")
        lost = bool(received.problem) and not received.data
        if received.problem:
            text = f"frame {index} {received.problem}"
            yield SourceEvent(timestamp_ns, "warning", text, dropped=int(lost))
        if not lost:
            yield CapturedFrame(
                index, timestamp_ns, received.arrival_ns, received.data, received.format
            )

    def _opened(self) -> Connection | None:
        """A new connection; None after `stop`, which does not wait for one that is being made."""
        opening: Future[Connection] = Future()

        def connect() -> None:
            try:
                opening.set_result(self._connect())
            except BaseException as error:
                opening.set_exception(error)

        threading.Thread(target=connect, name="connect", daemon=True).start()
        while not self._stopped.is_set():
            if wait([opening], _STOP_POLL_S).done:
                self._connection = opening.result()
                return self._connection
        opening.add_done_callback(_close_result)
        return None

    def _event(
        self, level: str, text: str, dropped: int = 0, connected: bool | None = None
    ) -> SourceEvent:
        silent_s = 0.0 if connected is None else self._progress.silent_s
        return SourceEvent(self._progress.last_ns, level, text, dropped, connected, silent_s)


def _close_result(opening: Future[Connection]) -> None:
    if opening.exception() is None:
        opening.result().close()


def _first_size(connection: Connection, spec: str) -> tuple[int, int]:
    """The size of the first whole image: what a camera gives at its start is often damaged."""
    until_s = time.monotonic() + _LOOK_S
    found = "nothing"
    while time.monotonic() < until_s:
        received = connection.receive()
        if received is None:
            continue
        fault = received.problem or image_fault(received.data, received.format)
        size = image_size(received.data)
        if fault is None and size is not None:
            return size
        found = fault or found
    raise InputError(spec, f"expected a whole image within {_LOOK_S:g} s, found: {found}")
