"""Markers as a PDF to print: exact sizes, ids, which way is up, cut marks, a ruler to check."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pipeline.geometry import Array
from pipeline.markers import MarkerMap, load_dictionary
from recorder.maps.plausibility import direction_text
from recorder.prints.paper import EDGE_MM, FOOT_MM, LABEL_MM, Cell, Layout, Page, lay_out
from recorder.prints.pattern import ink_cells, outlines

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CUT_MM = 3.0
_CUT_OFFSET_MM = 0.5
_GREY = "#808080"
_POINTS_PER_MM = 72.0 / 25.4

_RC: Any = {"pdf.fonttype": 42, "pdf.compression": 6, "path.simplify": False}


@dataclass(frozen=True)
class Print:
    """One marker to print.

    Attributes:
        size_m: side of the black square; inverted: of the white one.
        note: a line below its id, such as where it goes.
    """

    id: int
    size_m: float
    note: str = ""


@dataclass(frozen=True)
class Sheets:
    """A PDF and how it came out."""

    data: bytes
    pages: int
    markers: int


def prints_of_map(marker_map: MarkerMap) -> tuple[Print, ...]:
    """Every marker of a map, with where it goes."""
    prints = []
    for marker in marker_map.markers:
        # Adding 0 turns -0 into 0.
        x, y, z = (round(float(value), 3) + 0.0 for value in marker.centre_m)
        yaw_deg = round(math.degrees(marker.T_map_marker.yaw_rad), 1) + 0.0
        direction = direction_text(marker.normal)
        turn = f", yaw {yaw_deg:.1f} deg" if direction in ("up", "down") else ""
        note = f"at {x:.3f} {y:.3f} {z:.3f} m, faces {direction}{turn}"
        prints.append(Print(marker.id, marker.size_m, note))
    return tuple(prints)


def make_sheets(
    prints: Sequence[Print],
    dictionary: str,
    page: Page,
    *,
    inverted: bool = False,
    quiet_modules: float = 1.0,
    progress: Callable[[int], object] = lambda pages: None,
) -> Sheets:
    """The markers on as few pages as they fit on, those of one size together.

    Args:
        quiet_modules: width of the quiet zone in cells of the marker.
        progress: called with 1 after each page.

    Raises:
        ValueError: an unknown dictionary, an id outside it, or a marker too large for the page.
    """
    modules = load_dictionary(dictionary).markerSize + 2
    sheets: list[tuple[Layout, tuple[Print, ...]]] = []
    for size_m, group in groupby(sorted(prints, key=lambda p: p.size_m), key=lambda p: p.size_m):
        size_mm = round(1000.0 * size_m, 6)
        cell = Cell(size_mm, quiet_modules * size_mm / modules, inverted)
        layout = lay_out(page, cell)
        items, most = tuple(group), layout.per_page
        sheets += [(layout, items[i : i + most]) for i in range(0, len(items), most)]
    for item in prints:
        ink_cells(dictionary, item.id, inverted)

    import matplotlib
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    out = io.BytesIO()
    info = {"Title": f"{dictionary} markers", "Creator": "arucolog", "CreationDate": None}
    with matplotlib.rc_context(_RC), PdfPages(out, metadata=info) as pdf:
        for number, (layout, some) in enumerate(sheets, 1):
            width, height = layout.page.width_mm, layout.page.height_mm
            figure = Figure(figsize=(width / 25.4, height / 25.4))
            axes = figure.add_axes((0, 0, 1, 1))
            axes.set_axis_off()
            axes.set_xlim(0, width)
            axes.set_ylim(height, 0)
            for place, item in enumerate(some):
                _draw_cell(axes, layout, place, item, dictionary)
            _draw_foot(axes, layout.page, dictionary, f"page {number} of {len(sheets)}")
            pdf.savefig(figure)
            progress(1)
    return Sheets(out.getvalue(), len(sheets), len(prints))


def _draw_cell(axes: Axes, layout: Layout, place: int, item: Print, dictionary: str) -> None:
    cell = layout.cell
    left, top = layout.corner_mm(place)
    middle = left + cell.width_mm / 2
    square = np.array([left, top]) + cell.square_mm
    _draw_ink(axes, square, item.id, dictionary, cell)
    _draw_arrow(axes, middle, top)
    below = top + cell.height_mm - LABEL_MM
    label = f"id {item.id}   {dictionary}   {cell.size_mm:g} mm"
    room_mm = cell.width_mm - 2.0
    _draw_line(axes, (middle, below + 4.6), label, 9.0, room_mm, "center")
    if item.note:
        _draw_line(axes, (middle, below + 8.8), item.note, 7.0, room_mm, "center")
    _draw_cut_marks(axes, layout.page, left, top, cell)


def _draw_ink(axes: Axes, square: Array, marker_id: int, dictionary: str, cell: Cell) -> None:
    """All ink of a marker as one path, so that no seam can show between its cells."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    ink, quiet_rows = ink_cells(dictionary, marker_id, cell.inverted)
    module_mm = cell.size_mm / (ink.shape[0] - 2 * quiet_rows)
    vertices: list[list[float]] = []
    codes: list[np.uint8] = []
    for polygon in outlines(ink):
        points = (np.array(polygon) - quiet_rows).astype(np.float64)
        # A quiet zone of another width than a cell's moves the outermost edge.
        outside = (points < 0) | (points > ink.shape[0] - 2 * quiet_rows)
        shift = np.sign(points - 1) * (cell.quiet_mm / module_mm - 1.0)
        points = square + (points + outside * shift) * module_mm
        vertices += [*points.tolist(), points[0].tolist()]
        codes += [Path.MOVETO, *[Path.LINETO] * (len(points) - 1), Path.CLOSEPOLY]
    shape = PathPatch(Path(vertices, codes), facecolor="black", edgecolor="none", linewidth=0)
    axes.add_patch(shape)


def _draw_arrow(axes: Axes, middle: float, top: float) -> None:
    """Up in the print, which OpenCV's corners begin left of."""
    from matplotlib.patches import Polygon

    tip, wide, head, foot = top + 1.2, 1.8, 3.0, 5.6
    shape = [
        (middle, tip), (middle + wide, tip + head), (middle + 0.5, tip + head),
        (middle + 0.5, tip + foot), (middle - 0.5, tip + foot), (middle - 0.5, tip + head),
        (middle - wide, tip + head),
    ]  # fmt: skip
    axes.add_patch(Polygon(shape, closed=True, facecolor="black", edgecolor="none"))
    axes.text(middle + 3.0, top + 5.2, "up", fontsize=8, ha="left", va="baseline", color="black")


def _draw_cut_marks(axes: Axes, page: Page, left: float, top: float, cell: Cell) -> None:
    """Outside the corners, where there is paper."""
    for x, outward_x in ((left, -1), (left + cell.width_mm, 1)):
        for y, outward_y in ((top, -1), (top + cell.height_mm, 1)):
            near, far = _CUT_OFFSET_MM, _CUT_OFFSET_MM + _CUT_MM
            for start, end in (
                ((x + outward_x * near, y), (x + outward_x * far, y)),
                ((x, y + outward_y * near), (x, y + outward_y * far)),
            ):
                if 0 <= start[0] <= page.width_mm and 0 <= start[1] <= page.height_mm:
                    xs, ys = zip(start, end, strict=True)
                    axes.plot(xs, ys, color=_GREY, linewidth=0.4, solid_capstyle="butt")


def _draw_foot(axes: Axes, page: Page, dictionary: str, number: str) -> None:
    """A ruler for what the printer made of the size."""
    length = 100 if page.width_mm >= 120.0 else 50 if page.width_mm >= 70.0 else 20
    left = max(EDGE_MM + 2.0, (page.width_mm - length) / 2 if page.width_mm < 150 else 12.0)
    y = page.height_mm - FOOT_MM + 9.0
    line: Any = {"color": "black", "linewidth": 0.5, "solid_capstyle": "butt"}
    axes.plot([left, left + length], [y, y], **line)
    for mm in range(0, length + 1):
        tall = 3.0 if mm % 10 == 0 else 2.0 if mm % 5 == 0 else 1.2
        axes.plot([left + mm, left + mm], [y, y - tall], **(line | {"linewidth": 0.3}))
    for mm in range(0, length + 1, 10 if length <= 50 else 20):
        axes.text(left + mm, y + 2.9, str(mm), fontsize=6, ha="center", va="baseline")
    notes = [f"Print at 100 %, not fitted to the page: the ruler is {length} mm."]
    if dictionary.startswith("DICT_APRILTAG"):
        notes.append("Drawn as OpenCV does; AprilTag's own drawings are turned by 180 degrees.")
    x = max(EDGE_MM, left - 4.0)
    text = "   ".join([*notes, number])
    _draw_line(axes, (x, y + 7.4), text, 7.0, page.width_mm - x - EDGE_MM, "left")


def _draw_line(
    axes: Axes,
    place: tuple[float, float],
    text: str,
    points: float,
    room_mm: float,
    align: Literal["left", "center"],
) -> None:
    """Text of `points`, or smaller where that is too wide."""
    from matplotlib.textpath import TextPath

    width_mm = TextPath((0, 0), text, size=points).get_extents().width / _POINTS_PER_MM
    size = points * min(1.0, room_mm / width_mm)
    axes.text(*place, text, fontsize=size, ha=align, va="baseline", color="black")
