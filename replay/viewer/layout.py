"""The viewer's layouts: one result, several results of a log, and a log alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from pipeline.geometry import Array
from replay.viewer import style

# What the 3D view leaves room for around the scene, in multiples of its radius.
_EYE_DISTANCE = 1.5
# Where the eye stands, seen from the scene's centre: behind, a little left, well above.
_EYE_DIRECTION = np.array([-0.35, -1.0, 1.15])
# An overconfident filter's NIS goes far beyond, and would flatten everything else.
_NIS_RANGE = (0.0, 30.0)

_PLOT_NAMES = {
    "error": "Position error [m]",
    "path_distance": "Distance to truth path [m]",
    "innovation_x": "Innovation x, ±σ [m]",
    "innovation_y": "Innovation y, ±σ [m]",
    "nis": "NIS, 95 % below 5.99",
    "markers": "Markers",
}


@dataclass(frozen=True)
class ResultLayout:
    """One result to show and the kinds of plots that it has."""

    name: str
    plots: frozenset[str]


@dataclass(frozen=True, eq=False)
class SceneBounds:
    """The box around everything that the 3D view has to show, in map coordinates."""

    low_m: Array
    high_m: Array

    @classmethod
    def around(cls, *points_m: Array) -> SceneBounds:
        """Of all given points (N, 3); any set may be empty."""
        points = np.concatenate([np.asarray(p, dtype=np.float64).reshape(-1, 3) for p in points_m])
        if not len(points):
            points = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])
        return cls(points.min(axis=0), points.max(axis=0))

    @property
    def centre_m(self) -> Array:
        return (self.low_m + self.high_m) / 2.0

    @property
    def radius_m(self) -> float:
        return max(float(np.linalg.norm(self.high_m - self.low_m)) / 2.0, 0.1)


def results_layout(results: Sequence[ResultLayout], bounds: SceneBounds) -> rrb.Blueprint:
    """The layout for one result or several of the same log, the first of them leading."""
    paths = [style.ResultPaths(result.name) for result in results]
    scene = ["+ /map/**", "+ /truth/**", "+ /camera/**", f"- {style.CAMERA}/results/**"]
    for p in paths:
        scene += [f"+ {p.fixes}/**", f"+ {p.trackers}/**"]
    # The first result's camera is the one that carries the image.
    scene += [f"+ {p.camera}/**" for p in paths[1:]]
    # One result's corners: the others' would cover them.
    image = ["+ /camera/image/**", f"+ {paths[0].image_root}/**"]
    image_name = "Camera image" if len(results) == 1 else f"Camera image: {results[0].name}"
    events = ["+ /events/**", *(f"+ {p.events}/**" for p in paths)]
    top = rrb.Horizontal(
        _scene_view(scene, bounds),
        rrb.Vertical(_image_view(image, image_name), _events_view(events), row_shares=[7, 3]),
        column_shares=[3, 2],
    )
    return _blueprint(rrb.Vertical(top, rrb.Horizontal(*_plots(results, paths)), row_shares=[5, 4]))


def log_layout(bounds: SceneBounds, *, has_pose: bool, has_scene: bool) -> rrb.Blueprint:
    """The layout for a log that was not replayed; without a pose its camera has no place."""
    scene = ["+ /map/**", "+ /truth/**"] + (["+ /camera/**"] if has_pose else [])
    image = _image_view(["+ /camera/image/**"])
    events = _events_view(["+ /events/**"])
    if not has_scene:
        return _blueprint(rrb.Vertical(image, events, row_shares=[4, 1]))
    right = rrb.Vertical(image, events, row_shares=[7, 3])
    return _blueprint(rrb.Horizontal(_scene_view(scene, bounds), right, column_shares=[1, 1]))


def _blueprint(root: rrb.Container) -> rrb.Blueprint:
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=style.TIME, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def _scene_view(contents: list[str], bounds: SceneBounds) -> rrb.View:
    direction = _EYE_DIRECTION / np.linalg.norm(_EYE_DIRECTION)
    position = bounds.centre_m + direction * bounds.radius_m * _EYE_DISTANCE
    return rrb.Spatial3DView(
        name="Map and trajectories",
        origin="/",
        contents=contents,
        background=style.BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, color=(90, 95, 105, 110)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=position,
            look_target=bounds.centre_m,
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def _image_view(contents: list[str], name: str = "Camera image") -> rrb.View:
    return rrb.Spatial2DView(
        name=name,
        origin=style.CAMERA,
        contents=contents,
        background=style.BACKGROUND,
    )


def _events_view(contents: list[str]) -> rrb.View:
    kind = rrb.encodings.TextLogColumnKind
    columns = rrb.archetypes.TextLogColumns(
        text_log_columns=[rrb.encodings.TextLogColumn(k) for k in (kind.LogLevel, kind.Body)]
    )
    return rrb.TextLogView(name="Events", origin="/", contents=contents, columns=columns)


def _plots(
    results: Sequence[ResultLayout], paths: Sequence[style.ResultPaths]
) -> list[rrb.View | rrb.Container]:
    have = frozenset().union(*(result.plots for result in results))
    shown = [kind for kind in _PLOT_NAMES if kind in have]

    def plot(kind: str) -> rrb.View:
        # All plots share the trackers' colours: one legend is enough, and hides less.
        legend = kind in (shown[0], "markers")
        corner = rrb.Corner2D.LeftBottom if kind == "markers" else rrb.Corner2D.LeftTop
        contents = [f"+ {p.plot(kind)}/**" for p in paths]
        if kind == "markers" and len(results) > 1:
            contents += [f"- {p.plot(kind, 'detected')}" for p in paths]
        return rrb.TimeSeriesView(
            name=_PLOT_NAMES[kind],
            origin="/",
            contents=contents,
            plot_legend=rrb.PlotLegend(corner, visible=legend),
            background=rrb.archetypes.PlotBackground(color=style.BACKGROUND, show_grid=True),
            axis_x=rrb.archetypes.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal),
            axis_y=rrb.ScalarAxis(range=_NIS_RANGE) if kind == "nis" else None,
        )

    errors = [plot(kind) for kind in ("error", "path_distance") if kind in have]
    columns: list[rrb.View | rrb.Container] = []
    if errors:
        columns.append(rrb.Vertical(*errors) if len(errors) > 1 else errors[0])
    others = ("innovation_x", "innovation_y", "nis", "markers")
    return columns + [plot(kind) for kind in others if kind in have]
