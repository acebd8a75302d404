"""The viewer's layouts: one result, several results of a log, and a log alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal, TypedDict

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from pipeline.geometry import Array
from replay.viewer import style

# Rerun's eye sees 55° from bottom to top.
_TAN_HALF_VIEW = np.tan(np.radians(55.0 / 2.0))
# Where the eye stands, seen from the scene's centre: behind, a little left, well above.
_EYE_DIRECTION = np.array([-0.35, -1.0, 1.15])
# Width to height of the 3D view in a usual window, in the two layouts.
RESULT_ASPECT = 1.8
LOG_ASPECT = 0.9
# Room around the scene.
_MARGIN = 1.1
# An overconfident filter's NIS goes far beyond, and would flatten everything else.
_NIS_RANGE = (0.0, 30.0)
# What plots show of a drive that goes on.
_RECENT_S = 30.0

_PLOT_NAMES = {
    "error": "Position error [m]",
    "path_distance": "Distance to truth path [m]",
    "nis": "NIS, 95 % below 5.99",
    "markers": "Markers",
}

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Eye:
    """Where the 3D view looks from and to, and the radius of what it sees; map coordinates."""

    position_m: Point
    target_m: Point
    radius_m: float


@dataclass(frozen=True)
class ResultLayout:
    """What the layout has to know about one result.

    Attributes:
        plots: the kinds that it has: error, path_distance, innovation, nis, markers.
        innovation_limits_m: what each tracker's plot of innovations has to show.
    """

    name: str
    trackers: tuple[str, ...]
    plots: tuple[str, ...]
    innovation_limits_m: dict[str, float]
    max_markers: int
    eye: Eye

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> ResultLayout:
        values = json.loads(text)
        eye = values["eye"]
        return cls(
            values["name"],
            tuple(values["trackers"]),
            tuple(values["plots"]),
            values["innovation_limits_m"],
            values["max_markers"],
            Eye(tuple(eye["position_m"]), tuple(eye["target_m"]), eye["radius_m"]),
        )


def eye_on(*points_m: Array, aspect: float) -> Eye:
    """An eye that sees all given points (N, 3), any set of which may be empty.

    `aspect`: width to height of the view.
    """
    points = np.concatenate([np.empty((0, 3)), *(p.reshape(-1, 3) for p in points_m)])
    if not len(points):
        points = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])
    back = _EYE_DIRECTION / np.linalg.norm(_EYE_DIRECTION)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2.0
    x, y, z = (seen - middle).T
    radius_m = max(float(np.linalg.norm(np.ptp(points, axis=0))) / 2.0, 0.1)
    needed = np.maximum(np.abs(x) / aspect, np.abs(y)) / _TAN_HALF_VIEW + z
    distance = max(float(needed.max()), radius_m) * _MARGIN
    target = middle @ axes
    return Eye(_point(target + back * distance), _point(target), radius_m)


def _point(xyz: Array) -> Point:
    x, y, z = xyz.tolist()
    return x, y, z


def results_layout(results: Sequence[ResultLayout], *, live: bool = False) -> rrb.Blueprint:
    """The layout for one result or several of the same log, the first of them leading.

    `live`: it follows what comes in, and plots show the last of it.
    """
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
        _scene_view(scene, results[0].eye),
        rrb.Vertical(_image_view(image, image_name), _events_view(events), row_shares=[7, 3]),
        column_shares=[3, 2],
    )
    plots = _plots(results, paths, live)
    return _blueprint(rrb.Vertical(top, plots, row_shares=[5, 4]), live=live)


def log_layout(eye: Eye, *, has_pose: bool, has_scene: bool, live: bool = False) -> rrb.Blueprint:
    """The layout for a log that was not replayed; without a pose its camera has no place."""
    scene = ["+ /map/**", "+ /truth/**"] + (["+ /camera/**"] if has_pose else [])
    image = _image_view(["+ /camera/image/**"])
    events = _events_view(["+ /events/**"])
    if not has_scene:
        return _blueprint(rrb.Vertical(image, events, row_shares=[4, 1]), live=live)
    right = rrb.Vertical(image, events, row_shares=[7, 3])
    left = _scene_view(scene, eye)
    return _blueprint(rrb.Horizontal(left, right, column_shares=[1, 1]), live=live)


def _blueprint(root: rrb.Container, *, live: bool) -> rrb.Blueprint:
    play_state: Literal["following", "paused"] = "following" if live else "paused"
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=style.TIME, play_state=play_state),
        auto_views=False,
        auto_layout=False,
    )


def _scene_view(contents: list[str], eye: Eye) -> rrb.View:
    return rrb.Spatial3DView(
        name="Map and trajectories",
        origin="/",
        contents=contents,
        background=style.BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, color=(90, 95, 105, 110)),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position_m,
            look_target=eye.target_m,
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
    results: Sequence[ResultLayout], paths: Sequence[style.ResultPaths], live: bool
) -> rrb.Container:
    have = {kind for result in results for kind in result.plots}
    errors = [kind for kind in ("error", "path_distance") if kind in have]
    columns: list[rrb.View | rrb.Container] = []
    if errors:
        # All plots share the trackers' colours: one legend is enough, and hides less.
        stack = [_plot(kind, paths, live, legend=kind == errors[0]) for kind in errors]
        columns.append(rrb.Vertical(*stack) if len(stack) > 1 else stack[0])
    if "innovation" in have:
        columns.append(_innovations(results, paths, live))
    if "nis" in have:
        columns.append(_plot("nis", paths, live, legend=not errors, y_range=_NIS_RANGE))
    columns.append(_markers(results, paths, live))
    shares = [3, 4, 3, 2] if len(columns) == 4 else None
    return rrb.Horizontal(*columns, column_shares=shares)


def _innovations(
    results: Sequence[ResultLayout], paths: Sequence[style.ResultPaths], live: bool
) -> rrb.Container:
    """A tab for each tracker: several bands over each other show nothing."""
    trackers = dict.fromkeys(t for result in results for t in result.trackers)
    tabs = []
    for k, tracker in enumerate(trackers):
        have = [i for i, result in enumerate(results) if tracker in result.trackers]
        limit = max(results[i].innovation_limits_m.get(tracker, 0.0) for i in have)
        view = rrb.TimeSeriesView(
            name=f"Innovation ±σ [m]: {tracker}" if k == 0 else tracker,
            origin="/",
            contents=[f"+ {paths[i].innovation(tracker)}/**" for i in have],
            axis_y=rrb.ScalarAxis(range=(-limit, limit)) if limit > 0 else None,
            **_plot_style(rrb.Corner2D.LeftTop, live, legend=True),
        )
        tabs.append(view)
    return rrb.Tabs(*tabs, active_tab=0)


def _markers(
    results: Sequence[ResultLayout], paths: Sequence[style.ResultPaths], live: bool
) -> rrb.View:
    contents = [f"+ {p.plot('markers')}/**" for p in paths]
    if len(results) > 1:
        contents += [f"- {p.plot('markers', 'detected')}" for p in paths]
    y_range = (0.0, 1.05 * max(1, *(result.max_markers for result in results)))
    return rrb.TimeSeriesView(
        name="Markers",
        origin="/",
        contents=contents,
        axis_y=rrb.ScalarAxis(range=y_range),
        **_plot_style(rrb.Corner2D.LeftBottom, live, legend=True),
    )


def _plot(
    kind: str,
    paths: Sequence[style.ResultPaths],
    live: bool,
    *,
    legend: bool,
    y_range: tuple[float, float] | None = None,
) -> rrb.View:
    return rrb.TimeSeriesView(
        name=_PLOT_NAMES[kind],
        origin="/",
        contents=[f"+ {p.plot(kind)}/**" for p in paths],
        axis_y=None if y_range is None else rrb.ScalarAxis(range=y_range),
        **_plot_style(rrb.Corner2D.LeftTop, live, legend=legend),
    )


class _PlotStyle(TypedDict):
    plot_legend: rrb.PlotLegend
    background: rrb.archetypes.PlotBackground
    axis_x: rrb.archetypes.TimeAxis


def _plot_style(corner: rrb.Corner2D, live: bool, *, legend: bool) -> _PlotStyle:
    if live:
        recent = rr.TimeRange(
            start=rr.TimeRangeBoundary.cursor_relative(seconds=-_RECENT_S),
            end=rr.TimeRangeBoundary.cursor_relative(),
        )
        axis_x = rrb.archetypes.TimeAxis(view_range=recent)
    else:
        axis_x = rrb.archetypes.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    return {
        "plot_legend": rrb.PlotLegend(corner, visible=legend),
        "background": rrb.archetypes.PlotBackground(color=style.BACKGROUND, show_grid=True),
        "axis_x": axis_x,
    }
