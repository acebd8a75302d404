"""Several results of one log in one recording: what they share once, each in its own colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

from pipeline.geometry import Array
from replay.viewer import style
from replay.viewer.layout import ResultLayout, SceneBounds, results_layout
from replay.viewer.output import RecordingFile

_PLOTS = ("error", "path_distance", "innovation_x", "innovation_y", "nis", "markers")


@dataclass(frozen=True)
class ResultRecording:
    """One result's `replay.rrd`.

    Attributes:
        name: the result's name in the file.
        shown_as: its name in the overlay.
    """

    rrd: Path
    name: str
    trackers: tuple[str, ...]
    shown_as: str


def overlay(results: Sequence[ResultRecording], rrd: Path, log_id: str, name: str) -> None:
    """Writes one recording with all results of one log.

    Images, markers and truth come from the first; of the others only what is theirs.
    """
    results = distinct_names(results)
    file = RecordingFile(rrd, log_id, name)
    try:
        for k, result in enumerate(results):
            file.stream.send_chunks(_chunks(result, alone=k == 0))
        _restyle(file.stream, results)
        layouts = [ResultLayout(r.shown_as, _plots(r)) for r in results]
        file.stream.send_blueprint(results_layout(layouts, _bounds(results[0])))
    except BaseException:
        file.discard()
        raise
    file.close()


def distinct_names(results: Sequence[ResultRecording]) -> list[ResultRecording]:
    """The results, with a number behind a name that another one has too."""
    taken: set[str] = set()
    named = []
    for result in results:
        shown_as, n = result.shown_as, 1
        while shown_as in taken:
            n += 1
            shown_as = f"{result.shown_as} ({n})"
        taken.add(shown_as)
        named.append(replace(result, shown_as=shown_as))
    return named


def _chunks(result: ResultRecording, *, alone: bool) -> LazyChunkStream:
    own = style.ResultPaths(result.name)
    stream = RrdReader(result.rrd).stream()
    if not alone:
        stream = stream.filter(content=[f"+ {own.root}/**", f"+ {own.image_root}/**"])
    if result.shown_as == result.name:
        return stream
    shown = style.ResultPaths(result.shown_as)

    def rename(chunk: Chunk) -> Chunk:
        for before, after in ((own.root, shown.root), (own.image_root, shown.image_root)):
            path = chunk.entity_path
            if path == before or path.startswith(f"{before}/"):
                return chunk.with_entity_path(after + path.removeprefix(before))
        return chunk

    return stream.map(rename)


def _restyle(stream: rr.RecordingStream, results: Sequence[ResultRecording]) -> None:
    """Colours and names across results; what is static and logged last is what counts."""
    looks = style.overlay_looks([(r.shown_as, t) for r in results for t in r.trackers])
    for result in results:
        paths, plots = style.ResultPaths(result.shown_as), _plots(result)
        for tracker in result.trackers:
            look = looks[result.shown_as, tracker]
            entity = paths.tracker(tracker)
            stream.log(f"{entity}/path", look.path(), static=True)
            stream.log(f"{entity}/position", look.point(), static=True)
            stream.log(f"{entity}/ellipse", look.ellipse(), static=True)
            for kind in plots - {"markers"}:
                stream.log(paths.plot(kind, tracker), look.series(kind), static=True)
        first = looks[result.shown_as, result.trackers[0]]
        stream.log(paths.camera, rr.Pinhole.from_fields(color=first.colour), static=True)
        used = rr.SeriesLines(colors=first.colour, names=f"{result.shown_as}: used", widths=1.5)
        stream.log(paths.plot("markers", "used"), used, static=True)


def _static(result: ResultRecording, content: str) -> list[Chunk]:
    stream = RrdReader(result.rrd).store().stream()
    return stream.filter(content=content, is_static=True).to_chunks()


def _plots(result: ResultRecording) -> frozenset[str]:
    """The kinds of plots in the file: those that have a style."""
    paths = style.ResultPaths(result.name)
    entities = {chunk.entity_path for chunk in _static(result, f"{paths.root}/plots/**")}
    return frozenset(
        kind for kind in _PLOTS if any(e.startswith(f"{paths.plot(kind)}/") for e in entities)
    )


def _bounds(result: ResultRecording) -> SceneBounds:
    """The box around the markers and the trackers' paths of a result."""
    markers = _positions(_static(result, style.MARKERS), "Mesh3D:vertex_positions")
    fixes = style.ResultPaths(result.name).fixes
    ok = _positions(_static(result, f"{fixes}/ok"), "Points3D:positions")
    return SceneBounds.around(markers, ok)


def _positions(chunks: Sequence[Chunk], component: str) -> Array:
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            rows = batch.column(component).to_pylist()
            return np.array(rows, dtype=np.float64).reshape(-1, 3)
    return np.empty((0, 3))
