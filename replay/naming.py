"""Where results go and what they are called."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from recorder.errors import InputError
from recorder.files.yaml_file import read_bytes
from replay.run import ReplayOptions
from replay.settings_file import digest


def result_name(settings_path: Path | None, options: ReplayOptions) -> str:
    """The settings file's stem (or `default`) with 8 hex digits of all that was asked for.

    Raises:
        InputError: a file given in place of the log's cannot be read.
    """
    files = {
        key: hashlib.sha256(read_bytes(path)).hexdigest()
        for key, path in vars(options.overrides).items()
        if path is not None
    }
    stem = settings_path.stem if settings_path else "default"
    sha256 = digest(options.settings, from_s=options.from_s, to_s=options.to_s, **files)
    return f"{stem}-{sha256[:8]}"


def result_folders(logs: Sequence[Path], output: Path | None, name: str) -> list[tuple[Path, Path]]:
    """Each log with its result folder.

    Raises:
        InputError: the name is a path, or two logs would share a folder.
    """
    if name in (".", "..") or Path(name).name != name:
        raise InputError(f"--name {name}", "expected a plain name, without a path")
    if output is None:
        pairs = [(log, log.with_suffix(".results") / name) for log in logs]
    elif len(logs) == 1:
        # Whatever `..` is in it, the result has a name of its own.
        pairs = [(logs[0], output.resolve() if output.name in ("", "..") else output)]
    else:
        pairs = [(log, output / log.stem) for log in logs]
    taken: dict[Path, Path] = {}
    for log, folder in pairs:
        if folder in taken:
            raise InputError(log, f"expected logs of different names, found {taken[folder]} too")
        taken[folder] = log
    return pairs
