"""Names and colours in the viewer: one place, so that every file and layout agrees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import rerun as rr

from pipeline.geometry import Array

APPLICATION_ID = "arucolog"

# Timelines: the log's frame numbers, and seconds since the log's first image.
FRAME = "frame"
TIME = "time"

MAP = "/map"
MARKERS = "/map/markers"
MARKER_IDS = "/map/marker_ids"
CAMERA = "/camera"
IMAGE = "/camera/image"
TRUTH = "/truth"
TRUTH_EXACT = "/truth/exact"
EVENTS = "/events"

# Plots with one line for each tracker.
TRACKER_PLOTS = frozenset({"error", "path_distance", "nis"})

Colour = tuple[int, int, int]


class ResultPaths(NamedTuple):
    """Where the entities of one result live."""

    name: str

    @property
    def root(self) -> str:
        return f"/results/{part(self.name)}"

    @property
    def image_root(self) -> str:
        """What is drawn on the image has to live below the camera."""
        return f"{CAMERA}/results/{part(self.name)}"

    @property
    def detections(self) -> str:
        return f"{self.image_root}/detections"

    @property
    def corners(self) -> str:
        return f"{self.image_root}/corners"

    @property
    def labels(self) -> str:
        return f"{self.image_root}/labels"

    @property
    def camera(self) -> str:
        return f"{self.root}/camera"

    @property
    def fixes(self) -> str:
        return f"{self.root}/fixes"

    @property
    def trackers(self) -> str:
        return f"{self.root}/trackers"

    @property
    def events(self) -> str:
        return f"{self.root}/events"

    def tracker(self, tracker: str) -> str:
        return f"{self.trackers}/{part(tracker)}"

    @property
    def summary(self) -> str:
        """What the layout has to know about the result."""
        return f"{self.root}/summary"

    def plot(self, kind: str, series: str | None = None) -> str:
        """A time series; kinds: error, path_distance, nis, markers."""
        root = f"{self.root}/plots/{kind}"
        return root if series is None else f"{root}/{part(series)}"

    def innovation(self, tracker: str, axis: str | None = None) -> str:
        """A tracker's innovations; axes: x, y."""
        root = self.plot("innovation", tracker)
        return root if axis is None else f"{root}/{axis}"


# Okabe & Ito's palette, told apart also by the colour-blind; the paper's models keep theirs.
TRACKER_COLOURS: dict[str, Colour] = {
    "adaptive": (230, 159, 0),
    "min": (86, 180, 233),
    "max": (204, 121, 167),
    "mean": (0, 190, 140),
    "median": (240, 228, 66),
}
# For other names and for overlays, in this order.
PALETTE: tuple[Colour, ...] = (
    *TRACKER_COLOURS.values(),
    (235, 110, 60),
    (70, 125, 235),
    (190, 160, 255),
    (170, 220, 120),
    (255, 180, 180),
)

TRUTH_COLOUR: Colour = (255, 255, 255)
PATH_COLOUR: Colour = (150, 200, 160)
FIX_COLOUR: Colour = (150, 150, 160)
REJECTED_COLOUR: Colour = (225, 70, 60)
CAMERA_COLOUR: Colour = (190, 190, 200)
LABEL_COLOUR: Colour = (215, 220, 225)
DETECTED_COLOUR: Colour = (130, 140, 150)

# On the image: handed to the solver, known but left out, not in the map.
USED_COLOUR: Colour = (86, 220, 160)
UNUSED_COLOUR: Colour = (245, 190, 40)
UNKNOWN_COLOUR: Colour = (240, 90, 200)
FIRST_CORNER_COLOUR: Colour = (230, 50, 50)

# The layout does not follow a bright theme: pale lines need a dark ground.
BACKGROUND: Colour = (18, 20, 24)


def part(name: str) -> str:
    """A name as one part of an entity path."""
    return rr.escape_entity_path_part(name)


@dataclass(frozen=True)
class Look:
    """How one tracker of one result looks, in plots and in 3D.

    The first is drawn wider: it stays visible below another that runs along the same line.
    """

    name: str
    colour: Colour
    series_px: float
    path_px: float

    def series(self) -> rr.SeriesLines:
        """Its line in a plot of all trackers."""
        return rr.SeriesLines(colors=self.colour, names=self.name, widths=self.series_px)

    def innovation(self, axis: str) -> rr.Measurements:
        """Its line and ±σ band along one axis; y is paler than x."""
        colour = self.colour if axis == "x" else _paler(self.colour)
        return rr.Measurements.from_fields(colors=colour, names=f"{self.name} {axis}", widths=1.5)

    def path(self) -> rr.LineStrips3D:
        return rr.LineStrips3D.from_fields(colors=self.colour, radii=-self.path_px / 2)

    def point(self) -> rr.Points3D:
        return rr.Points3D.from_fields(colors=self.colour, radii=-5.0)

    def ellipse(self) -> rr.Ellipsoids3D:
        return rr.Ellipsoids3D.from_fields(
            colors=self.colour,
            line_radii=-1.0,
            fill_mode=rr.components.FillMode.MajorWireframe,
        )


def tracker_looks(names: Iterable[str]) -> dict[str, Look]:
    """A look for each tracker of one result."""
    names = list(names)
    return {
        name: _look(name, colour, first=i == 0)
        for i, (name, colour) in enumerate(zip(names, _distinct(names), strict=True))
    }


def overlay_looks(pairs: Sequence[tuple[str, str]]) -> dict[tuple[str, str], Look]:
    """A look for each (result, tracker); a tracker's own colour goes to the first that has it."""
    colours = _distinct([tracker for _, tracker in pairs])
    return {
        (result, tracker): _look(f"{result}/{tracker}", colour, first=i == 0)
        for i, ((result, tracker), colour) in enumerate(zip(pairs, colours, strict=True))
    }


def _look(name: str, colour: Colour, *, first: bool) -> Look:
    return Look(name, colour, 5.0 if first else 1.5, 5.0 if first else 2.5)


def _paler(colour: Colour) -> Colour:
    r, g, b = ((channel + 2 * 255) // 3 for channel in colour)
    return r, g, b


def _distinct(trackers: Sequence[str]) -> list[Colour]:
    chosen: dict[int, Colour] = {}
    for i, tracker in enumerate(trackers):
        own = TRACKER_COLOURS.get(tracker)
        if own is not None and own not in chosen.values():
            chosen[i] = own
    free = [colour for colour in PALETTE if colour not in chosen.values()]
    for n, i in enumerate(i for i in range(len(trackers)) if i not in chosen):
        # More series than colours: a name then tells them apart.
        chosen[i] = free[n] if n < len(free) else PALETTE[n % len(PALETTE)]
    return [chosen[i] for i in range(len(trackers))]


def to_rerun_pixels(pixels: Array) -> Array:
    """Pixels of OpenCV (centres at integers) to Rerun's, where the first pixel spans 0 to 1."""
    return pixels + 0.5
