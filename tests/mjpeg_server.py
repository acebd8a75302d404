"""An HTTP MJPEG camera on loopback that can be told to go wrong.

In a thread (`MjpegServer`) or in a process of its own (`MjpegProcess`), with the same script and
the same record of what was served. Alone: `python -m tests.mjpeg_server '{"rate_hz": 30}' RECORD`.
"""

from __future__ import annotations

import hashlib
import json
import random
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import cv2
import numpy as np

FaultKind = Literal["stall", "disconnect", "cut", "down", "corrupt", "truncated", "empty"]

_POOL = 8
_LISTEN_POLL_S = 0.05


@dataclass(frozen=True)
class Fault:
    """What happens at a frame.

    `stall`: nothing for `seconds` in the middle of it; `disconnect`: the connection is closed
    before it; `cut`: in the middle of it; `down`: before it, and nobody listens for `seconds`;
    `corrupt`: random bytes in it; `truncated`: half of it as if it were all; `empty`: no bytes.
    A cut frame is sent again, whole, to whoever connects next.
    """

    kind: FaultKind
    seconds: float = 0.0


@dataclass(frozen=True)
class Script:
    """What to serve.

    Attributes:
        count: frames, then silence; None: without end.
        rate_hz: None: as fast as they are taken.
        frame_bytes: frames are filled up to this size, where they are smaller.
        jitter_s: each frame is late by up to this, at random.
        length: parts say their Content-Length.
        chunked: the response is HTTP/1.1's chunks, one a part.
        stamps: parts carry X-Timestamp, the server's clock moved by `stamp_shifts_s` from that
            frame on.
        looks: connections that are served good frames before the script begins: a source looks
            before it records.
        faults: by frame number.
    """

    count: int | None = None
    rate_hz: float | None = None
    width_px: int = 64
    height_px: int = 48
    frame_bytes: int = 0
    jitter_s: float = 0.0
    length: bool = True
    chunked: bool = False
    stamps: bool = False
    stamp_shifts_s: Mapping[int, float] = field(default_factory=dict)
    looks: int = 1
    faults: Mapping[int, Fault] = field(default_factory=dict)
    boundary: str = "frame"
    seed: int = 1

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Script:
        values: dict[str, Any] = json.loads(text)
        values["faults"] = {int(k): Fault(**v) for k, v in values.get("faults", {}).items()}
        shifts = values.get("stamp_shifts_s", {})
        values["stamp_shifts_s"] = {int(k): v for k, v in shifts.items()}
        return cls(**values)


@dataclass(frozen=True)
class Served:
    """One frame of the script as it went out.

    Attributes:
        kind: `good`, or the fault that changed its bytes; `cut` where only half of it was sent.
        sha256: of the bytes that were (or, cut, would have been) sent.
        sent_ns: system clock when the kernel had taken the last byte.
        stamp_ns: what X-Timestamp said, else 0.
    """

    number: int
    connection: int
    kind: str
    size: int
    sha256: str
    sent_ns: int
    stamp_ns: int


class Frames:
    """Grey JPEGs that differ in every number, made in microseconds."""

    def __init__(self, script: Script) -> None:
        rng = np.random.default_rng(script.seed)
        self._random = random.Random(script.seed)
        self._starts = []
        for _ in range(_POOL):
            size = (script.width_px, script.height_px)
            small = rng.integers(0, 256, (max(1, size[1] // 32), max(1, size[0] // 32)), np.uint8)
            image = cv2.resize(small, size, interpolation=cv2.INTER_CUBIC)
            start = cv2.imencode(".jpg", image)[1].tobytes()[:-2]
            # A comment is at most 65533 bytes, and the last one, with the number, takes 14.
            while (missing := script.frame_bytes - len(start) - 14) > 4:
                fill = rng.bytes(min(missing - 4, 65533))
                start += b"\xff\xfe" + struct.pack(">H", len(fill) + 2) + fill
            self._starts.append((start, hashlib.sha256(start)))

    def good(self, number: int) -> tuple[bytes, str]:
        """The frame of a number, and its SHA-256."""
        start, digest = self._starts[number % _POOL]
        end = b"\xff\xfe\x00\x0a" + struct.pack(">Q", number) + b"\xff\xd9"
        whole = digest.copy()
        whole.update(end)
        return start + end, whole.hexdigest()

    def corrupt(self, number: int) -> bytes:
        data = bytearray(self.good(number)[0])
        for _ in range(max(8, len(data) // 100)):
            data[self._random.randrange(2, len(data))] = self._random.randrange(256)
        return bytes(data)


class MjpegServer:
    """Serves a script to one client after another; use it in a `with` block."""

    def __init__(self, script: Script, log: Path | None = None) -> None:
        self.script = script
        self._frames = Frames(script)
        self._log = log.open("w", buffering=1) if log else None
        self._served: list[Served] = []
        self._next = 0
        self._connections = 0
        self._done = -1
        self._started_s: float | None = None
        self._stopped = threading.Event()
        self.finished = threading.Event()
        self._down_until_s = 0.0
        self._listener = _listen(0)
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._run, name="mjpeg server", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/stream"

    def served(self) -> list[Served]:
        """The script's frames so far, in order."""
        return list(self._served)

    def stop(self) -> None:
        self._stopped.set()
        self._thread.join(timeout=10)
        if self._log:
            self._log.close()

    def wait(self) -> None:
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    def _run(self) -> None:
        while not self._stopped.is_set():
            if (wait_s := self._down_until_s - time.monotonic()) > 0:
                self._listener.close()
                self._stopped.wait(wait_s)
                self._listener = _listen(self.port)
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            with client, suppress(OSError):
                client.settimeout(None)
                self._serve(client, self._connections)
            self._connections += 1
        self._listener.close()

    def _serve(self, client: socket.socket, connection: int) -> None:
        client.settimeout(0.2)
        request = b""
        while b"\r\n\r\n" not in request:
            request += client.recv(4096)
        kind = f"multipart/x-mixed-replace; boundary={self.script.boundary}"
        version = (
            "1.1 200 OK\r\nTransfer-Encoding: chunked" if self.script.chunked else "1.0 200 OK"
        )
        client.sendall(f"HTTP/{version}\r\nContent-Type: {kind}\r\n\r\n".encode())
        if connection < self.script.looks:
            for number in range(2**40, 2**41):
                if self._stopped.is_set():
                    return
                self._send(client, self._frames.good(number)[0], self._stamp_ns())
                self._stopped.wait(0.005)
            return
        while not self._stopped.is_set():
            if self.script.count is not None and self._next >= self.script.count:
                self.finished.set()
                self._stopped.wait(_LISTEN_POLL_S)
            elif not self._serve_next(client, connection):
                return

    def _serve_next(self, client: socket.socket, connection: int) -> bool:
        """Whether the connection lives on."""
        script, number = self.script, self._next
        fault = script.faults.get(number)
        kind = fault.kind if fault else "good"
        if fault and kind in ("disconnect", "down") and not self._is_done(number):
            self._done = number
            self._down_until_s = time.monotonic() + fault.seconds
            return False
        self._pace(number)
        data, sha256 = self._frames.good(number)
        if kind in ("corrupt", "truncated", "empty"):
            kinds = {"truncated": data[: len(data) // 2], "empty": b""}
            data = kinds[kind] if kind in kinds else self._frames.corrupt(number)
            sha256 = hashlib.sha256(data).hexdigest()
        stamp_ns = self._stamp_ns(sum(s for n, s in script.stamp_shifts_s.items() if n <= number))
        if fault and kind == "cut" and not self._is_done(number):
            self._done = number
            self._send(client, data, stamp_ns, half_only=True)
            self._note(Served(number, connection, "cut", len(data), sha256, time.time_ns(), 0))
            return False
        self._send(client, data, stamp_ns, fault.seconds if fault and kind == "stall" else 0.0)
        kind = kind if kind in ("corrupt", "truncated", "empty") else "good"
        sent_ns = time.time_ns()
        self._note(Served(number, connection, kind, len(data), sha256, sent_ns, stamp_ns))
        self._next += 1
        return True

    def _stamp_ns(self, shift_s: float = 0.0) -> int:
        return (time.time_ns() // 1000 + round(shift_s * 1e6)) * 1000 if self.script.stamps else 0

    def _is_done(self, number: int) -> bool:
        """Faults that close the connection happen once."""
        return self._done == number

    def _pace(self, number: int) -> None:
        if self.script.rate_hz is None:
            return
        if self._started_s is None:
            self._started_s = time.monotonic()
        late_s = self.script.jitter_s * random.Random(number).random()
        due_s = self._started_s + number / self.script.rate_hz + late_s
        self._stopped.wait(max(0.0, due_s - time.monotonic()))

    def _send(
        self,
        client: socket.socket,
        data: bytes,
        stamp_ns: int,
        stall_s: float = 0.0,
        half_only: bool = False,
    ) -> None:
        head = f"--{self.script.boundary}\r\nContent-Type: image/jpeg\r\n"
        if self.script.length:
            head += f"Content-Length: {len(data)}\r\n"
        if stamp_ns:
            head += f"X-Timestamp: {stamp_ns // 10**9}.{stamp_ns % 10**9 // 1000:06d}\r\n"
        body = head.encode() + b"\r\n" + data + b"\r\n"
        if self.script.chunked:
            body = b"%x\r\n%b\r\n" % (len(body), body)
        message = memoryview(body)
        half = len(message) // 2
        self._send_all(client, message[:half])
        if half_only:
            return
        if stall_s:
            self._stopped.wait(stall_s)
        self._send_all(client, message[half:])

    def _send_all(self, client: socket.socket, rest: memoryview) -> None:
        # Not sendall: a client that takes nothing more must not keep the server from stopping.
        while rest:
            if self._stopped.is_set():
                raise ConnectionAbortedError
            with suppress(TimeoutError):
                rest = rest[client.send(rest) :]

    def _note(self, served: Served) -> None:
        self._served.append(served)
        if self._log:
            self._log.write(json.dumps(asdict(served)) + "\n")


class MjpegProcess:
    """The same in a process of its own, so that it costs its clients nothing but the wire."""

    module = "tests.mjpeg_server"

    def __init__(self, script: Script, log: Path, *more: str) -> None:
        self.script = script
        self._log = log
        self._process = subprocess.Popen(
            [sys.executable, "-m", self.module, script.to_json(), str(log), *more],
            stdout=subprocess.PIPE,
            stdin=subprocess.PIPE,
            cwd=Path(__file__).resolve().parents[1],
            text=True,
        )
        assert self._process.stdout is not None
        self.url = self._process.stdout.readline().strip()

    def served(self) -> list[Served]:
        lines = self._log.read_text().splitlines(keepends=True)
        return [Served(**json.loads(line)) for line in lines if line.endswith("\n")]

    def kill(self) -> None:
        """As a server dies that nobody has asked."""
        self._process.kill()
        self._process.communicate()

    def stop(self) -> None:
        if self._process.poll() is None:
            self._process.terminate()
        self._process.communicate()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()


def _listen(port: int) -> socket.socket:
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(("127.0.0.1", port))
    listener.listen()
    listener.settimeout(_LISTEN_POLL_S)
    return listener


if __name__ == "__main__":
    server = MjpegServer(Script.from_json(sys.argv[1]), Path(sys.argv[2]))
    print(server.url, flush=True)
    server.wait()
