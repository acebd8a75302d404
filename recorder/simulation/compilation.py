"""Machine code from Python functions, kept from run to run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Machine code that runs without the interpreter lock.

    A compiled function calls only those of its own file: the cache notices no other file's change.
    """
    return cast(Function, numba.njit(cache=True, nogil=True)(function))


def is_kept(function: Callable[..., Any]) -> bool:
    """Whether a `compiled` function finds its machine code, as far as the files' dates tell."""
    dispatcher = cast(Any, function)
    python = dispatcher.py_func
    source = Path(python.__code__.co_filename)
    version = f"py{sys.version_info.major}{sys.version_info.minor}"
    # As numba names its index files.
    names = f"{source.stem}.{python.__qualname__}-{python.__code__.co_firstlineno}.{version}*.nbi"
    changed_s = source.stat().st_mtime
    kept = Path(dispatcher.stats.cache_path).glob(names)
    return any(index.stat().st_mtime >= changed_s for index in kept)
