"""The disk under a recording: how much is left of it, and that what was written is on it."""

from __future__ import annotations

import queue
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from recorder.errors import InputError
from recorder.quantities import size_text

_LOOK_S = 0.25
_LOOK_BYTES = 16 << 20
# A recording promises to lose a second at most.
_SLOW_S = 1.0


class DiskGuard:
    """Watches the free space in a folder.

    Attributes:
        free_bytes: when it last looked.
    """

    def __init__(self, folder: Path, min_free_bytes: int) -> None:
        """`min_free_bytes`: what a recording leaves free."""
        self._folder = folder
        self._min_free_bytes = min_free_bytes
        self._looked_at = 0.0
        self._looked_bytes = 0
        self.free_bytes = 0

    def check_start(self, path: Path) -> None:
        """Refuse to begin on a disk that is full already.

        Raises:
            InputError: there is less space than is to be left.
        """
        if self.is_low(0):
            raise InputError(
                path,
                f"expected more than {size_text(self._min_free_bytes)} of free disk space, found "
                f"{size_text(self.free_bytes)} (--min-free sets what is left free)",
            )

    def is_low(self, written_bytes: int) -> bool:
        """Whether to stop; looks every quarter of a second and every 16 MiB."""
        now = time.monotonic()
        soon = now - self._looked_at < _LOOK_S
        if soon and 0 <= written_bytes - self._looked_bytes < _LOOK_BYTES:
            return False
        self._looked_at, self._looked_bytes = now, written_bytes
        try:
            disk = shutil.disk_usage(self._folder)
        except OSError:
            return False  # the folder is gone: writing will say so
        self.free_bytes = disk.free
        # Some file systems do not tell their size.
        return disk.total > 0 and disk.free < self._min_free_bytes


class SyncThread(threading.Thread):
    """Puts what was written on the disk whenever it is asked to, while others go on.

    Attributes:
        error: why that failed.
    """

    def __init__(self, sync: Callable[[], None]) -> None:
        super().__init__(name="sync", daemon=True)
        self._sync = sync
        self._asked = threading.Event()
        self._ending = False
        self._slow: queue.SimpleQueue[float] = queue.SimpleQueue()
        self.error: Exception | None = None

    def ask(self) -> None:
        """Soon, please; asked while it is at work, it does it once more."""
        self._asked.set()

    def slow(self) -> Iterator[str]:
        """What to say of those that took too long since the last call."""
        while not self._slow.empty():
            yield (
                f"the disk took {self._slow.get():.1f} s to sync: a power loss meanwhile would "
                "have cost more than the last second"
            )

    def close(self) -> None:
        """Wait until it has ended."""
        self._ending = True
        self._asked.set()
        if self.is_alive():
            self.join()

    def run(self) -> None:
        while True:
            self._asked.wait()
            self._asked.clear()
            if self._ending:
                return
            begun = time.monotonic()
            try:
                self._sync()
            except Exception as error:
                self.error = error
                return
            if (took_s := time.monotonic() - begun) > _SLOW_S:
                self._slow.put(took_s)
