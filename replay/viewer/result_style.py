"""Colours and names of one result's entities, logged once."""

from __future__ import annotations

from collections.abc import Mapping, Set

import rerun as rr

from replay.viewer import style

RAW_FIX = "raw fix"


def log_styles(
    stream: rr.RecordingStream,
    paths: style.ResultPaths,
    looks: Mapping[str, style.Look],
    plots: Set[str],
) -> None:
    """Styles for everything that comes row by row, for the kinds of plots that there are."""
    log = stream.log
    for name, look in looks.items():
        for kind in plots - {"markers"}:
            log(paths.plot(kind, name), look.series(kind), static=True)
        entity = paths.tracker(name)
        log(f"{entity}/position", look.point(), static=True)
        log(f"{entity}/ellipse", look.ellipse(), static=True)
    raw = rr.SeriesPoints(colors=style.FIX_COLOUR, names=RAW_FIX, marker_sizes=1.5)
    for kind in plots & {"error", "path_distance"}:
        log(paths.plot(kind, RAW_FIX), raw, static=True)
    if "nis" in plots:
        bound = rr.SeriesLines(colors=style.REJECTED_COLOUR, names="95 % bound", widths=1.0)
        log(paths.plot("nis", "bound"), bound, static=True)
    for name, colour in (("detected", style.DETECTED_COLOUR), ("used", style.USED_COLOUR)):
        line = rr.SeriesLines(
            colors=colour,
            names=name,
            widths=1.5,
            interpolation_mode=rr.components.InterpolationMode.StepAfter,
        )
        log(paths.plot("markers", name), line, static=True)
    log(paths.detections, rr.LineStrips2D.from_fields(radii=-1.0), static=True)
    log(paths.corners, rr.Points2D.from_fields(radii=-2.0), static=True)
    log(paths.labels, rr.Points2D.from_fields(radii=0.0, show_labels=True), static=True)
