"""Colours and names of one result's entities, logged once."""

from __future__ import annotations

from collections.abc import Mapping, Set

import rerun as rr

from pipeline.camera import Camera
from replay.viewer import scene, style
from replay.viewer.layout import Eye

RAW_FIX = "raw fix"


def log_styles(
    stream: rr.RecordingStream,
    paths: style.ResultPaths,
    looks: Mapping[str, style.Look],
    plots: Set[str],
) -> None:
    """Styles for everything that comes row by row, for the kinds of plots that there are."""
    log = stream.log
    log_looks(stream, paths, looks, plots)
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


def log_looks(
    stream: rr.RecordingStream,
    paths: style.ResultPaths,
    looks: Mapping[str, style.Look],
    plots: Set[str],
) -> None:
    """The trackers' looks; what is static and logged last is what counts."""
    log = stream.log
    for name, look in looks.items():
        for kind in plots & style.TRACKER_PLOTS:
            log(paths.plot(kind, name), look.series(), static=True)
        for axis in ("x", "y") if "innovation" in plots else ():
            log(paths.innovation(name, axis), look.innovation(axis), static=True)
        entity = paths.tracker(name)
        log(f"{entity}/path", look.path(), static=True)
        log(f"{entity}/position", look.point(), static=True)
        log(f"{entity}/ellipse", look.ellipse(), static=True)


def log_cameras(
    stream: rr.RecordingStream,
    paths: style.ResultPaths,
    looks: Mapping[str, style.Look],
    camera: Camera,
    eye: Eye,
) -> None:
    """The camera that carries the image, and the result's own."""
    # Small enough not to hide the trajectories behind it.
    distance_m = 0.12 * eye.radius_m
    pinhole = scene.pinhole(camera, distance_m, style.CAMERA_COLOUR)
    stream.log(style.CAMERA, pinhole, static=True)
    own = scene.pinhole(camera, distance_m, next(iter(looks.values())).colour)
    stream.log(paths.camera, own, static=True)
