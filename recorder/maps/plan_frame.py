"""What is around a plan: the grid in metres, the scale bar, what the signs mean."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from pipeline.markers import MarkerMap
from recorder.info_text import counted
from recorder.maps.plausibility import direction_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

View = Literal["top", "front", "side"]

FOOT_MM = 30.0
# A smaller square has no room for a dot, nor for a circle inside it.
SMALL_MM = 4.0
# A smaller square is drawn of this size: it could not be seen.
LEAST_MM = 1.2
# Okabe & Ito: told apart also by the colour-blind.
COLOURS = {"down": "#0072b2", "up": "#d55e00"}
WALL_COLOUR = "#009e73"
_INK = "#202020"
_FAINT = "#9a9a9a"
_GREY = "#707070"

_SEEN = {"top": "from above", "front": "along y", "side": "against x"}


def draw_grid(axes: Axes, right: str, up: str, mm_per_m: float) -> None:
    """Lines at round metres, with their numbers inside the frame."""
    steps = [1, 2, 5]
    step = next(s * 10.0**e for e in range(-3, 5) for s in steps if s * 10.0**e * mm_per_m >= 18)
    for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        # Not where the frame would cut the number or the axis' name is.
        low, high = limits[0] + 5 / mm_per_m, limits[1] - 12 / mm_per_m
        ticks = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
        axis.set_ticks(ticks.tolist(), [f"{tick + 0.0:g}" for tick in np.round(ticks, 6)])
    axes.grid(color="#e4e4e4", linewidth=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(direction="in", length=0, pad=-4, labelsize=7, labelcolor=_GREY)
    for label in axes.get_xticklabels():
        label.set_verticalalignment("bottom")
    for label in axes.get_yticklabels():
        label.set_horizontalalignment("left")
    for spine in axes.spines.values():
        spine.set_color(_FAINT)
        spine.set_linewidth(0.5)
    style: Any = {"fontsize": 7, "color": _GREY, "transform": axes.transAxes}
    axes.text(0.997, 0.004, f"{right} / m", ha="right", va="bottom", **style)
    axes.text(0.004, 0.996, f"{up} / m", ha="left", va="top", **style)


def draw_foot(
    figure: Figure,
    marker_map: MarkerMap,
    title: str,
    scale: int,
    view: View,
    factor: float,
    page_mm: tuple[float, float],
) -> None:
    """Scale bar, scale, and what the signs mean."""
    width, height = page_mm[0], page_mm[1] + FOOT_MM
    sizes = sorted({round(marker.size_m, 4) for marker in marker_map.markers})
    side = f"{sizes[0]:g}" if len(sizes) == 1 else f"{sizes[0]:g} to {sizes[-1]:g}"
    facing = {direction_text(m.normal) for m in marker_map.markers}
    looked_down_on = view == "top" and "down" in facing
    backs = ": those facing down show their back, mirrored" if looked_down_on else ""
    smallest_mm, largest_mm = (size * 1000.0 / scale for size in (sizes[0], sizes[-1]))
    lines = [
        f"{title + ': ' if title else ''}{counted(len(marker_map.markers), 'marker')} of {side} m, "
        f"{marker_map.dictionary}, frame {marker_map.frame}",
        f"1 : {scale}, seen {_SEEN[view]}{backs}",
        "arrow: up in the print (edge-on: out of the face)"
        + ("; dot: its top left corner" if largest_mm > SMALL_MM else "")
        + (f"; circle: {factor:g} std_m" if any(m.std_m for m in marker_map.markers) else ""),
    ]
    if smallest_mm < LEAST_MM:
        lines.append(f"squares are drawn of {LEAST_MM:g} mm at least: these are not to scale")
    for i, line in enumerate(lines):
        figure.text(6 / width, (FOOT_MM - 15 - 4.2 * i) / height, line, fontsize=7.5, va="center")
    length_m = _bar_length_m(scale, width)
    bar = length_m * 1000.0 / scale
    y = FOOT_MM - 8.0
    axes = figure.add_axes((0, 0, 1, FOOT_MM / height))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(0, FOOT_MM)
    for i in range(4):
        face = _INK if i % 2 == 0 else "white"
        axes.barh(y, bar / 4, 1.6, left=6 + i * bar / 4, color=face, edgecolor=_INK, lw=0.5)
    for share in (0.0, 0.5, 1.0):
        axes.text(6 + share * bar, y + 1.6, f"{share * length_m:g}", fontsize=7, ha="center")
    axes.text(6 + bar + 3.5, y + 1.6, "m", fontsize=7, ha="left")
    x = 6 + bar + 14
    for name, colour in (*COLOURS.items(), ("sideways", WALL_COLOUR)):
        if name in facing or (colour == WALL_COLOUR and facing - set(COLOURS)):
            axes.barh(y, 2.6, 2.6, left=x, color=(*rgb(colour), 0.13), edgecolor=colour, lw=0.9)
            axes.text(x + 3.8, y, f"faces {name}", fontsize=7, va="center_baseline")
            x += 24


def _bar_length_m(scale: int, width_mm: float) -> float:
    most_m = min(60.0, 0.35 * width_mm) * scale / 1000.0
    return max(s * 10.0**e for e in range(-4, 4) for s in (1, 2, 4) if s * 10.0**e <= most_m)


def rgb(colour: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(colour)
