"""Logs and results in the Rerun viewer, or in one file to look at elsewhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from recorder.errors import InputError
from recorder.log.reader import LogReader
from replay.result import Result, open_result
from replay.viewer.output import NotWrittenError
from replay.viewer.overlay import ResultRecording, overlay
from replay.viewer.program import has_display, viewer_program
from replay.viewer.raw import convert

REPLAY_RRD = "replay.rrd"


def view(
    paths: Sequence[Path],
    *,
    spawn: bool = True,
    save: Path | None = None,
    force: bool = False,
    warn: Callable[[str], None] = lambda text: None,
) -> None:
    """Shows logs or results of one log, until the viewer is closed.

    Args:
        spawn: open the viewer; without it (and without `save`) only the files are made and checked.
        save: write one .rrd file there, and open nothing.
        force: replace a file `save` that exists, unless it is what `paths` show.
        warn: told what a person should know of a log.

    Raises:
        InputError: a path is neither, results are of different logs or have no recording, `save`
            exists, cannot be written or would have to hold several logs, or there is no screen.
    """
    if save is not None and save.exists():
        given = [path / REPLAY_RRD if path.is_dir() else path for path in paths]
        if any(save.samefile(path) for path in given if path.exists()):
            raise InputError(save, "expected a file to write, found one to view")
        if not force:
            raise InputError(save, "already exists; --force replaces it")
    if save is None and spawn and not has_display():
        raise InputError(
            paths[0], "no screen to show it on; --save FILE.rrd makes a file to open elsewhere"
        )
    target = None if save is None else save.resolve().parent
    with tempfile.TemporaryDirectory(prefix=".view-", dir=target) as folder:
        try:
            recordings = prepare(paths, Path(folder), warn)
        except NotWrittenError as error:
            raise InputError(
                save or folder, f"the recording could not be written: {error.reason}"
            ) from error
        if save is not None:
            _save(recordings, save, Path(folder))
        elif spawn:
            _show(recordings)


def prepare(
    paths: Sequence[Path], folder: Path, warn: Callable[[str], None] = lambda text: None
) -> list[Path]:
    """The recordings to open, made in `folder` where they are not there already."""
    results = [open_result(path) for path in paths if path.is_dir()]
    logs = [path for path in paths if not path.is_dir()]
    if not results:
        recordings = []
        for k, log in enumerate(dict.fromkeys(logs)):
            recordings.append(folder / f"{k}-{log.stem}.rrd")
            if shortfall := convert(log, recordings[-1]):
                warn(f"{log}: {shortfall}")
        return recordings
    log_id = str(results[0].summary["log_sha256"])
    for result in results[1:]:
        if result.summary["log_sha256"] != log_id:
            raise _different_logs(result.folder, results[0])
    for log in logs:
        with LogReader(log) as reader:
            if reader.sha256() != log_id:
                raise _different_logs(log, results[0])
    rrds = [_recording(result) for result in results]
    if len(results) == 1:
        return rrds
    merged = folder / "overlay.rrd"
    recordings_of = [
        ResultRecording(rrd, result.name, result.folder.resolve().name)
        for rrd, result in zip(rrds, results, strict=True)
    ]
    overlay(recordings_of, merged, log_id, Path(str(results[0].summary["log"])).stem)
    return [merged]


def _recording(result: Result) -> Path:
    rrd = result.folder / REPLAY_RRD
    if not rrd.exists():
        raise InputError(
            result.folder,
            f"expected {REPLAY_RRD}, found none; replay the log again without --no-rrd",
        )
    return rrd


def _different_logs(path: Path, first: Result) -> InputError:
    return InputError(
        path,
        f"expected results of one log, found another log than that of {first.folder}; "
        "view them one at a time",
    )


def _save(recordings: Sequence[Path], save: Path, temporary: Path) -> None:
    if len(recordings) > 1:
        raise InputError(save, f"expected one log with --save, found {len(recordings)}")
    (recording,) = recordings
    if recording.parent == temporary:
        os.replace(recording, save)
        return
    part = temporary / save.name
    with recording.open("rb") as source:
        try:
            with part.open("wb") as copy:
                shutil.copyfileobj(source, copy, 1 << 20)
            os.replace(part, save)
        except OSError as error:
            raise InputError(save, f"could not be written: {error.strerror or error}") from error


def _show(recordings: Sequence[Path]) -> None:
    """Blocks until the viewer is closed: the files may be temporary."""
    # A viewer of its own: one that already runs would take the files over and return at once.
    command = [str(viewer_program()), "--port", "auto", "--bind", "127.0.0.1"]
    try:
        code = subprocess.call([*command, *map(str, recordings)])
    except KeyboardInterrupt:
        return
    if code != 0:
        raise InputError(recordings[0], f"the viewer ended with exit code {code}")
