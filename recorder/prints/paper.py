"""Pages, and how many markers of a size fit on one."""

from __future__ import annotations

import re
from dataclasses import dataclass

PAGES_MM: dict[str, tuple[float, float]] = {
    "A5": (148.0, 210.0),
    "A4": (210.0, 297.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}

# What printers leave white at the edge of the paper.
EDGE_MM = 6.0
# Below the markers: the ruler and what to do with it.
FOOT_MM = 22.0
# Above and below each quiet zone: the arrow; the id.
HEAD_MM = 8.0
LABEL_MM = 11.0
# Room for a label that can be read.
NARROWEST_MM = 30.0
# Between cells, for the cut marks.
GAP_MM = 8.0
MOST_MM = 5000.0


@dataclass(frozen=True)
class Page:
    """A sheet of paper, upright or on its side."""

    name: str
    width_mm: float
    height_mm: float

    def turned(self) -> Page:
        return Page(self.name, self.height_mm, self.width_mm)


@dataclass(frozen=True)
class Cell:
    """One marker with what is cut out around it.

    Attributes:
        size_mm: side of the black square (inverted: of the white one).
        quiet_mm: width of the quiet zone around it.
        inverted: its quiet zone is ink, which has to stay off the edge of the paper.
    """

    size_mm: float
    quiet_mm: float
    inverted: bool

    @property
    def width_mm(self) -> float:
        return max(self.size_mm + 2 * self.quiet_mm, NARROWEST_MM)

    @property
    def height_mm(self) -> float:
        return self.size_mm + 2 * self.quiet_mm + HEAD_MM + LABEL_MM

    @property
    def square_mm(self) -> tuple[float, float]:
        """Top left corner of the square, from that of the cell."""
        return (self.width_mm - self.size_mm) / 2, HEAD_MM + self.quiet_mm


@dataclass(frozen=True)
class Layout:
    """Cells on a page, centred, in rows from the top."""

    page: Page
    cell: Cell
    rows: int
    cols: int

    @property
    def per_page(self) -> int:
        return self.rows * self.cols

    def corner_mm(self, place: int) -> tuple[float, float]:
        """Top left corner of a cell, from the top left of the page."""
        row, col = divmod(place, self.cols)
        across = self.cols * (self.cell.width_mm + GAP_MM) - GAP_MM
        down = self.rows * (self.cell.height_mm + GAP_MM) - GAP_MM
        left = (self.page.width_mm - across) / 2
        top = max(EDGE_MM, (self.page.height_mm - FOOT_MM - down) / 2)
        x = left + col * (self.cell.width_mm + GAP_MM)
        return x, top + row * (self.cell.height_mm + GAP_MM)


def parse_page(text: str) -> Page:
    """A name, or `300x400` in millimetres.

    Raises:
        ValueError: neither.
    """
    for name, (width, height) in PAGES_MM.items():
        if name.lower() == text.lower():
            return Page(name, width, height)
    number = r"(\d+(?:\.\d+)?)"
    match = re.fullmatch(rf"{number}x{number}", text.lower().removesuffix("mm"))
    if match is None:
        raise ValueError(f"expected {', '.join(PAGES_MM)} or WIDTHxHEIGHT in mm, found {text!r}")
    width, height = (float(group) for group in match.groups())
    if min(width, height) < 50.0 or max(width, height) > MOST_MM:
        raise ValueError(f"expected a page of 50 to {MOST_MM:g} mm, found {text!r}")
    return Page(text, width, height)


def lay_out(page: Page, cell: Cell) -> Layout:
    """As many cells as fit, upright or with the page on its side.

    Raises:
        ValueError: not even one does; names the page that would do.
    """
    layout = max((_grid(page, cell), _grid(page.turned(), cell)), key=lambda grid: grid.per_page)
    if layout.per_page:
        return layout
    enough = [
        name
        for name, (width, height) in PAGES_MM.items()
        if any(
            _grid(Page(name, *size), cell).per_page for size in ((width, height), (height, width))
        )
    ]
    american = page.name in ("letter", "legal", "tabloid")
    enough.sort(key=lambda name: american == name.startswith("A"))
    width, height = _needed_mm(cell)
    if max(width, height) > MOST_MM:
        raise ValueError(
            f"a marker of {cell.size_mm:g} mm needs {width / 1000:.1f} x {height / 1000:.1f} m of "
            "paper (--size-mm is in millimetres, --size-m in metres)"
        )
    advice = f"{enough[0]} would do" if enough else f"--page {width:.0f}x{height:.0f} would do"
    raise ValueError(
        f"a marker of {cell.size_mm:g} mm needs {width:.0f} x {height:.0f} mm with its quiet "
        f"zone: more than {page.name} has; {advice}"
    )


def _needed_mm(cell: Cell) -> tuple[float, float]:
    edge = _side_edge_mm(cell)
    return float(-(-(cell.width_mm + 2 * edge) // 1)), float(
        -(-(cell.height_mm + EDGE_MM + FOOT_MM) // 1)
    )


def _side_edge_mm(cell: Cell) -> float:
    """A quiet zone of bare paper may reach into what printers leave white."""
    return EDGE_MM if cell.inverted else max(0.0, EDGE_MM - cell.quiet_mm)


def _grid(page: Page, cell: Cell) -> Layout:
    across = page.width_mm - 2 * _side_edge_mm(cell)
    down = page.height_mm - EDGE_MM - FOOT_MM
    cols = int((across + GAP_MM) // (cell.width_mm + GAP_MM))
    rows = int((down + GAP_MM) // (cell.height_mm + GAP_MM))
    return Layout(page, cell, max(rows, 0), max(cols, 0))
