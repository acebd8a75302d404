"""How every figure looks: sizes, colours, marks; readable on a screen and in print."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

# Inches; at write_study's 150 dpi a wide figure is 1275 pixels.
WIDE = (8.5, 4.8)
SINGLE = (5.2, 4.4)

# The viewer's colours (Okabe & Ito's palette, told apart also by the colour-blind), as hex.
TRACKER_COLOURS: dict[str, str] = {
    "adaptive": "#e69f00",
    "min": "#56b4e9",
    "max": "#cc79a7",
    "mean": "#00be8c",
    "median": "#f0e442",
}
# For what has no colour of its own, in this order; all dark enough on white.
PALETTE: tuple[str, ...] = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#e69f00",
    "#56b4e9",
    "#7f5fbf",
    "#5c5c5c",
)
# Shapes beside the colours, for print without colours.
SHAPES: tuple[str, ...] = ("s", "D", "^", "o", "v", "P", "X", "*")

TRUTH_COLOUR = "#000000"
FAINT = "#9a9a9a"
# Values in order (counts, magnitudes): dark to light, also in grey.
SEQUENTIAL = "viridis"

_RC: Any = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.labelsize": 10.0,
    "legend.fontsize": 9.0,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "axes.grid": True,
    "grid.color": "#e0e0e0",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.facecolor": "white",
    "legend.frameon": False,
    # Names inside an SVG come from this, not from chance: the same study gives the same file.
    "svg.hashsalt": "arucolog",
}


def new_figure(size: tuple[float, float] = WIDE) -> Figure:
    """An empty figure that draws without a screen and keeps its own layout."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    matplotlib.rcParams.update(_RC)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def tracker_colours(names: Iterable[str]) -> dict[str, str]:
    """A colour for each tracker: its own, else the next of the palette that is free."""
    names = list(names)
    chosen = {name: TRACKER_COLOURS[name] for name in names if name in TRACKER_COLOURS}
    free = [colour for colour in PALETTE if colour not in chosen.values()]
    others = [name for name in names if name not in chosen]
    return chosen | {name: free[i % len(free)] for i, name in enumerate(others)}


def plain_log_scale(axis: Axis) -> None:
    """Labels at 1, 2, 5, 10 … as plain numbers: few enough never to overlap."""
    from matplotlib.ticker import LogLocator

    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    axis.set_minor_formatter("{x:g}")
