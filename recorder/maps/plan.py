"""A map as a plan to scale: which marker is where, and which way it is turned."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from pipeline.geometry import Array
from pipeline.markers import Marker, MarkerMap
from recorder.files.output_file import check_suffix
from recorder.files.truth_file import Truth
from recorder.maps.plan_frame import (
    COLOURS,
    FOOT_MM,
    LEAST_MM,
    SMALL_MM,
    WALL_COLOUR,
    View,
    draw_foot,
    draw_grid,
    rgb,
)
from recorder.maps.plausibility import direction_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PlanFormat = Literal["svg", "pdf", "png"]

# The map axes that point right and up on the paper.
_AXES: dict[View, tuple[int, int]] = {"top": (0, 1), "front": (0, 2), "side": (1, 2)}
_SCALES = (1, 2, 5, 10, 20, 25, 50, 100, 200, 250, 500, 1000, 2000, 5000, 10000)
_LONGEST_MM = 340.0
_MARGIN_MM = 22.0
_NARROWEST_MM = 120.0
_PAPER_MM = 2000.0
_MM_PER_POINT = 25.4 / 72.0

_TRUTH_COLOUR = "#000000"

_RC: Any = {
    "font.size": 8.0,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    # Names inside an SVG come from this, not from chance: the same map gives the same file.
    "svg.hashsalt": "arucolog",
}


@dataclass(frozen=True)
class PlanOptions:
    """How to draw.

    Attributes:
        scale: 1 : scale on paper; None: the largest usual one that fits on A3.
        view: from above, or along y (`front`), or against x (`side`), for walls.
    """

    scale: int | None = None
    view: View = "top"
    dpi: int = 200


@dataclass(frozen=True)
class Plan:
    """A drawing, its scale, and how many markers lie over another one in it."""

    data: bytes
    scale: int
    hidden: int


def plan_format(path: Path) -> PlanFormat:
    """By the suffix.

    Raises:
        InputError: not one that can be drawn.
    """
    check_suffix(path, [f".{kind}" for kind in get_args(PlanFormat)])
    return path.suffix.lower()[1:]  # type: ignore[return-value]


def draw_plan(
    marker_map: MarkerMap,
    kind: PlanFormat,
    options: PlanOptions | None = None,
    truth: Truth | None = None,
    title: str = "",
) -> Plan:
    """The plan as a file: the squares to scale, ids, up arrows, circles of std_m, the true path.

    Raises:
        ValueError: the scale makes a paper of more than two metres.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    options = options or PlanOptions()
    truth = truth if options.view == "top" else None
    right, up = _AXES[options.view]
    points = [marker.corners_m[:, [right, up]] for marker in marker_map.markers]
    if truth is not None:
        points += _truth_points(truth)
    low = np.concatenate(points).min(axis=0)
    high = np.concatenate(points).max(axis=0)
    scale = options.scale or _fitting_scale(float((high - low).max()))
    mm_per_m = 1000.0 / scale
    page = (high - low) * mm_per_m + 2 * _MARGIN_MM
    width, height = max(float(page[0]), _NARROWEST_MM), float(page[1])
    if max(width, height) > _PAPER_MM:
        raise ValueError(
            f"expected a scale for paper of at most {_PAPER_MM:g} mm, found 1 : {scale} "
            f"({width:.0f} x {height:.0f} mm)"
        )
    with matplotlib.rc_context(_RC):
        figure = Figure(figsize=(width / 25.4, (height + FOOT_MM) / 25.4))
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0, FOOT_MM / (height + FOOT_MM), 1, height / (height + FOOT_MM)))
        centre, half = (low + high) / 2, np.array([width, height]) / mm_per_m / 2
        axes.set_xlim(centre[0] - half[0], centre[0] + half[0])
        axes.set_ylim(centre[1] - half[1], centre[1] + half[1])
        draw_grid(axes, "xyz"[right], "xyz"[up], mm_per_m)
        if truth is not None:
            _draw_truth(axes, truth)
        factor = _std_factor(marker_map.markers, mm_per_m)
        for marker in marker_map.markers:
            _draw_marker(axes, marker, options.view, mm_per_m, factor)
        draw_foot(figure, marker_map, title, scale, options.view, factor, (width, height))
        out = io.BytesIO()
        dates: dict[str, dict[str, Any]] = {
            "svg": {"Date": None},
            "pdf": {"CreationDate": None},
            "png": {"Software": None},
        }
        figure.savefig(out, format=kind, dpi=options.dpi, metadata=dates[kind])
    return Plan(out.getvalue(), scale, _hidden(marker_map.markers, right, up))


def _fitting_scale(extent_m: float) -> int:
    room = _LONGEST_MM - 2 * _MARGIN_MM
    return next((s for s in _SCALES if extent_m * 1000.0 / s <= room), _SCALES[-1])


def _draw_marker(axes: Axes, marker: Marker, view: View, mm_per_m: float, factor: float) -> None:
    from matplotlib.patches import Circle, Polygon

    right, up = _AXES[view]
    plane = [right, up]
    colour = COLOURS.get(direction_text(marker.normal), WALL_COLOUR)
    size_mm = marker.size_m * mm_per_m
    line = float(np.clip(size_mm / 12.0, 0.35, 1.2))
    centre = marker.centre_m[plane]
    corners = marker.corners_m[:, plane]
    if size_mm < LEAST_MM:
        corners = centre + (corners - centre) * (LEAST_MM / size_mm)
    outline = Polygon(
        corners.tolist(), closed=True, facecolor=(*rgb(colour), 0.13),
        edgecolor=colour, linewidth=line, zorder=3,
    )  # fmt: skip
    axes.add_patch(outline)
    edge_on = abs(float(marker.normal[3 - right - up])) < 0.35
    # The arrow is the print's up; edge-on there is none to see, and the face's direction helps.
    direction = (marker.normal if edge_on else marker.T_map_marker.rotation[:, 1])[plane]
    tip = centre + direction * max(marker.size_m * 0.5, 2.2 / mm_per_m) * (1.35 if edge_on else 1.0)
    axes.annotate(
        "", xy=tuple(tip), xytext=tuple(centre), zorder=4,
        arrowprops={"arrowstyle": "-|>,head_width=0.14,head_length=0.3", "color": colour,
                    "linewidth": line, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    if not edge_on and size_mm > SMALL_MM:
        first = marker.corners_m[0, plane]
        inward = first + (centre - first) * 0.2
        axes.add_patch(
            Circle(tuple(inward), 0.07 * marker.size_m, color=colour, linewidth=0, zorder=4)
        )
    if marker.std_m is not None:
        axes.add_patch(
            Circle(tuple(centre), factor * marker.std_m, fill=False, edgecolor=colour,
                   linewidth=0.6, linestyle=(0, (2, 1.5)), zorder=4)
        )  # fmt: skip
    _draw_id(axes, marker, centre, direction, size_mm, mm_per_m, edge_on)


def _draw_id(
    axes: Axes,
    marker: Marker,
    centre: Array,
    arrow: Array,
    size_mm: float,
    mm_per_m: float,
    edge_on: bool,
) -> None:
    """Inside the square, below the arrow's foot, where there is room; else beside it."""
    text = str(marker.id)
    points = float(np.clip(0.34 * size_mm / _MM_PER_POINT, 6.0, 14.0))
    height_mm = points * _MM_PER_POINT
    width_mm = 0.62 * height_mm * len(text)
    away = -arrow / max(float(np.linalg.norm(arrow)), 1e-9)
    if not edge_on and width_mm < 0.8 * size_mm and height_mm < 0.45 * size_mm:
        at = centre + away * 0.25 * marker.size_m
    else:
        # As far as the text's own half width or height asks for, in that direction.
        half_mm = (abs(away[0]) * width_mm + abs(away[1]) * height_mm) / 2
        clear_mm = (0.0 if edge_on else 0.5 * max(size_mm, LEAST_MM)) + half_mm + 0.7
        at = centre + away * clear_mm / mm_per_m
    paper: Any = {"boxstyle": "square,pad=0.04", "facecolor": (1, 1, 1, 0.9), "linewidth": 0}
    axes.text(
        float(at[0]), float(at[1]), text, fontsize=points, ha="center", va="center_baseline",
        color="#202020", zorder=6, bbox=paper,
    )  # fmt: skip


def _draw_truth(axes: Axes, truth: Truth) -> None:
    style: Any = {"color": _TRUTH_COLOUR, "zorder": 2}
    if truth.path is not None:
        points = truth.path.points_m
        if truth.path.closed:
            points = np.concatenate([points, points[:1]])
        axes.plot(points[:, 0], points[:, 1], linewidth=0.9, linestyle=(0, (5, 2)), **style)
    for pose in truth.places:
        axes.plot([pose.x_m], [pose.y_m], marker="+", markersize=6, **style)
        if pose.yaw_rad is not None:
            axes.annotate(
                "", xy=(pose.x_m, pose.y_m),
                xytext=(14 * np.cos(pose.yaw_rad), 14 * np.sin(pose.yaw_rad)),
                textcoords="offset points", zorder=2,
                arrowprops={"arrowstyle": "<-", "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip
    if truth.trajectory is not None:
        places = truth.trajectory.positions_m
        axes.plot(places[:, 0], places[:, 1], linewidth=0.7, **style)


def _truth_points(truth: Truth) -> list[Array]:
    points = [np.array([[pose.x_m, pose.y_m]]) for pose in truth.places]
    if truth.path is not None:
        points.append(truth.path.points_m)
    if truth.trajectory is not None:
        points.append(truth.trajectory.positions_m[:, :2])
    return points


def _std_factor(markers: Sequence[Marker], mm_per_m: float) -> float:
    """How much circles of std_m are drawn too large, so that millimetres show."""
    known = [marker for marker in markers if marker.std_m is not None]
    if not known:
        return 1.0
    std_m = float(np.median([marker.std_m for marker in known if marker.std_m]))
    size_m = float(np.median([marker.size_m for marker in known]))
    wanted = max(0.6 * size_m, 0.9 * SMALL_MM / mm_per_m) / std_m
    factors = (s * 10.0**e for e in range(6) for s in (1, 2, 5))
    return max((factor for factor in factors if factor <= wanted), default=1.0)


def _hidden(markers: Sequence[Marker], right: int, up: int) -> int:
    """How many markers have a centre within another one's half side, in this view."""
    centres = np.array([marker.centre_m for marker in markers])[:, [right, up]]
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(distances, np.inf)
    sizes = np.array([marker.size_m for marker in markers])
    return int((distances < sizes / 2).any(axis=1).sum())
