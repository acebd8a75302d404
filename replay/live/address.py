"""Where the live view is shown: a viewer on this machine, started if need be, or on another."""

from __future__ import annotations

import socket
import subprocess
from contextlib import suppress
from dataclasses import dataclass

from recorder.errors import InputError
from replay.viewer.program import has_display, viewer_program

_PORT = 9876
_CONNECT_S = 1.0
# Of the viewer that is started here; beyond it, it forgets the oldest.
_VIEWER_MEMORY = "25%"
_VIEWER_BUFFER = "128MB"


@dataclass(frozen=True)
class Address:
    """A viewer's host and port."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @property
    def url(self) -> str:
        return f"rerun+http://{self}/proxy"

    def listens(self) -> bool:
        """Whether somebody does, there."""
        with suppress(OSError), socket.create_connection((self.host, self.port), _CONNECT_S):
            return True
        return False


def parse_address(text: str) -> Address:
    """From `HOST` or `HOST:PORT`, also `[IPv6]:PORT`.

    Raises:
        ValueError: anything else.
    """
    host, colon, port = text.rpartition(":")
    if not colon or text.endswith("]"):
        host, port = text, str(_PORT)
    host = host.removeprefix("[").removesuffix("]")
    # A bare number would be a host by the letter, and is a port by intent.
    is_host = bool(host) and "/" not in host and not host.isdecimal()
    if not is_host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise ValueError(f"expected HOST or HOST:PORT of a Rerun viewer, found {text!r}")
    return Address(host, int(port))


def local_viewer() -> Address:
    """The viewer of this machine; it is started if it does not run, and outlives us.

    Raises:
        InputError: there is no screen, or no viewer.
    """
    address = Address("127.0.0.1", _PORT)
    if address.listens():
        return address
    if not has_display():
        raise InputError(
            "--live", "no screen to show it on; --live HOST shows it on another machine's viewer"
        )
    command = [str(viewer_program()), "--bind", address.host, "--port", str(address.port)]
    command += ["--memory-limit", _VIEWER_MEMORY, "--server-memory-limit", _VIEWER_BUFFER]
    # In a session of its own: Ctrl-C is for the recording.
    subprocess.Popen(
        [*command, "--hide-welcome-screen"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    return address
