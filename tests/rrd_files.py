"""Reads back what is in a Rerun file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rerun.chunk import Chunk, RrdReader

from replay.viewer import style


def chunks(path: Path, entity: str) -> list[Chunk]:
    return RrdReader(path).stream().filter(content=entity).to_chunks()


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(path).stream()}


def rows(path: Path, entity: str, component: str) -> dict[int, Any]:
    """A component's values by frame."""
    found: dict[int, Any] = {}
    for chunk in chunks(path, entity):
        batch = chunk.to_record_batch()
        if chunk.is_static or component not in batch.schema.names:
            continue
        frames: list[Any] = batch.column(style.FRAME).to_pylist()
        found.update(zip(frames, batch.column(component).to_pylist(), strict=True))
    return found


def static(path: Path, entity: str, component: str) -> Any:
    """A static component; the last one logged counts."""
    found: Any = []
    for chunk in chunks(path, entity):
        batch = chunk.to_record_batch()
        if chunk.is_static and component in batch.schema.names:
            found = batch.column(component).to_pylist()[-1]
    return found
