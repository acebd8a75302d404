"""Several results of one log in one recording: what they share once, each in its own colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import rerun as rr
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

from recorder.errors import InputError
from replay.viewer import style
from replay.viewer.layout import ResultLayout, results_layout
from replay.viewer.output import RecordingFile
from replay.viewer.result_style import log_looks


@dataclass(frozen=True)
class ResultRecording:
    """One result's `replay.rrd`.

    Attributes:
        name: the result's name in the file.
        shown_as: its name in the overlay.
    """

    rrd: Path
    name: str
    shown_as: str


def overlay(results: Sequence[ResultRecording], rrd: Path, log_id: str, name: str) -> None:
    """Writes one recording with all results of one log.

    Images, markers and truth come from the first; of the others only what is theirs.
    """
    results = distinct_names(results)
    layouts = [read_layout(result) for result in results]
    file = RecordingFile(rrd, log_id, name)
    try:
        for k, result in enumerate(results):
            file.copy(_chunks(result, alone=k == 0))
        _restyle(file.stream, layouts)
        file.stream.send_blueprint(results_layout(layouts))
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


def _restyle(stream: rr.RecordingStream, layouts: Sequence[ResultLayout]) -> None:
    """Colours and names that are distinct across results."""
    looks = style.overlay_looks([(r.name, t) for r in layouts for t in r.trackers])
    for result in layouts:
        paths = style.ResultPaths(result.name)
        own = {tracker: looks[result.name, tracker] for tracker in result.trackers}
        log_looks(stream, paths, own, frozenset(result.plots))
        colour = next(iter(own.values())).colour
        stream.log(paths.camera, rr.Pinhole.from_fields(color=colour), static=True)
        used = rr.SeriesLines(colors=colour, names=f"{result.name}: used", widths=1.5)
        stream.log(paths.plot("markers", "used"), used, static=True)


def read_layout(result: ResultRecording) -> ResultLayout:
    """What the file says about itself.

    Raises:
        InputError: it says nothing.
    """
    summary = style.ResultPaths(result.name).summary
    try:
        for chunk in RrdReader(result.rrd).store().stream().filter(content=summary):
            column = chunk.to_record_batch().column("TextDocument:text")
            return replace(ResultLayout.from_json(column[0].as_py()[0]), name=result.shown_as)
    except (RuntimeError, ValueError) as error:
        raise InputError(
            result.rrd, f"expected a Rerun recording, found: {error}; replay the log again"
        ) from error
    raise InputError(result.rrd, f"expected {summary}, found none; replay the log again")
