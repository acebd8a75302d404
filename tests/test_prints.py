"""Sheets of markers: what a printer gets is rendered and read back with the detector."""

from __future__ import annotations

import errno
from pathlib import Path

import cv2
import numpy as np
import pypdfium2  # type: ignore[import-untyped]
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.detection import GrayImage
from pipeline.geometry import Array
from pipeline.markers import Marker, MarkerMap, dictionary_names, load_dictionary
from recorder.errors import InputError
from recorder.files.map_file import map_yaml
from recorder.marker_ids import parse_ids
from recorder.prints.paper import PAGES_MM, Cell, Page, lay_out, parse_page
from recorder.prints.pattern import ink_cells, outlines
from recorder.prints.sheets import Print, make_sheets, prints_of_map
from recorder.prints_cli import markers

DPI = 300
MM = DPI / 25.4
A4 = Page("A4", 210.0, 297.0)


def rendered(data: bytes, page: int = 0, dpi: float = DPI) -> GrayImage:
    """A page as a printer's raster."""
    bitmap = pypdfium2.PdfDocument(data)[page].render(scale=dpi / 72.0, grayscale=True)
    return np.ascontiguousarray(bitmap.to_numpy().reshape(bitmap.height, bitmap.width))


def read_back(image: GrayImage, dictionary: str, inverted: bool = False) -> dict[int, Array]:
    """Corners (4, 2) of each marker in millimetres from the top left of the page."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.detectInvertedMarker = inverted
    detector = cv2.aruco.ArucoDetector(load_dictionary(dictionary), parameters)
    corners, ids, _ = detector.detectMarkers(image)
    assert ids is not None
    found = [int(i) for i in ids.ravel()]
    assert len(set(found)) == len(found)
    # Pixel centres are integers, so the page begins at -0.5.
    return {
        i: (np.asarray(c, dtype=np.float64).reshape(4, 2) + 0.5) / MM
        for i, c in zip(found, corners, strict=True)
    }


def check_square(corners_mm: Array, size_mm: float) -> None:
    """Upright, first corner top left, and of the right size to a tenth of a millimetre."""
    sides = np.linalg.norm(np.roll(corners_mm, -1, axis=0) - corners_mm, axis=1)
    assert np.abs(sides - size_mm).max() < 0.1
    expected = corners_mm[0] + size_mm * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    assert np.abs(corners_mm - expected).max() < 0.1


@pytest.mark.parametrize(
    ("dictionary", "size_mm", "inverted", "page"),
    [
        ("DICT_6X6_1000", 150.0, False, "A4"),
        pytest.param("DICT_APRILTAG_36h11", 165.1, False, "letter", marks=pytest.mark.slow),
        ("DICT_4X4_50", 33.3, True, "A4"),
        ("DICT_5X5_100", 12.0, False, "100x150"),
    ],
)
def test_what_is_printed_is_read_back(
    dictionary: str, size_mm: float, inverted: bool, page: str
) -> None:
    prints = [Print(i, size_mm / 1000.0) for i in (3, 7, 11)]
    paper = parse_page(page)
    made = make_sheets(prints, dictionary, paper, inverted=inverted)
    document = pypdfium2.PdfDocument(made.data)
    assert len(document) == made.pages
    found: dict[int, Array] = {}
    for number in range(made.pages):
        size = np.array(document[number].get_size()) * 25.4 / 72.0
        assert sorted(size) == pytest.approx(sorted((paper.width_mm, paper.height_mm)), abs=1e-3)
        found |= read_back(rendered(made.data, number), dictionary, inverted)
    assert set(found) == {3, 7, 11}
    for corners_mm in found.values():
        check_square(corners_mm, size_mm)


def test_the_arrow_is_above_the_markers_top_edge() -> None:
    image = rendered(make_sheets([Print(5, 0.1)], "DICT_APRILTAG_16h5", A4).data)
    corners_px = read_back(image, "DICT_APRILTAG_16h5")[5] * MM
    middle = corners_px[:2].mean(axis=0)
    ink = {}
    for name, down_mm in (("above", -20.0), ("below", 100.0 + 13.0)):
        left, top = (middle + np.array([-1.7, down_mm - 4.0]) * MM).astype(int)
        ink[name] = int((image[top : top + int(9 * MM), left : left + int(3.4 * MM)] < 128).sum())
    # Head 3.6 x 3 mm and shaft 1 x 2.6 mm: 8 mm2; below are letters.
    assert ink["above"] / MM**2 == pytest.approx(8.0, rel=0.1)
    # The arrow's tip is narrower than its head.
    column = int(middle[0])
    rows = np.flatnonzero(image[int(middle[1] - 25 * MM) : int(middle[1] - 14 * MM), column] < 128)
    top = rows[0] + int(middle[1] - 25 * MM)
    widths = [int((image[top + d, column - 40 : column + 40] < 128).sum()) for d in (5, 30)]
    assert widths[0] < widths[1]


def test_who_cuts_along_the_marks_keeps_the_quiet_zone() -> None:
    image = rendered(make_sheets([Print(5, 0.06)], "DICT_4X4_50", A4).data)
    corners_mm = read_back(image, "DICT_4X4_50")[5]
    (left, top), (right, bottom) = corners_mm[0], corners_mm[2]
    inked = image < 230
    # Short straight strokes of nothing but themselves, across and down.
    strokes: dict[int, list[float]] = {0: [], 1: []}
    count, _, boxes, centres = cv2.connectedComponentsWithStats(inked.astype(np.uint8))
    for (_, _, width, height, _), centre in zip(boxes[1:count], centres[1:count], strict=True):
        long_mm, thick_mm = max(width, height) / MM, min(width, height) / MM
        if 2.5 < long_mm < 6.0 and thick_mm < 0.5:
            axis = int(width > height)
            strokes[axis].append((centre[axis] + 0.5) / MM)
    # Two corners' marks on each line of the cut: its left, right, upper and lower edge.
    for axis, near, far in ((0, left, right), (1, top, bottom)):
        marks = np.sort(strokes[axis])
        assert len(marks) == 4, marks
        assert marks[1] - marks[0] < 0.2
        assert marks[3] - marks[2] < 0.2
        quiet_mm = 60 / 6
        assert marks[:2].max() <= near - quiet_mm + 0.1
        assert marks[2:].min() >= far + quiet_mm - 0.1


@pytest.mark.parametrize(("page", "length_mm"), [("A4", 100), ("A3", 100), ("100x100", 50)])
def test_the_ruler_is_as_long_as_it_says(page: str, length_mm: int) -> None:
    image = rendered(make_sheets([Print(0, 0.02)], "DICT_4X4_50", parse_page(page)).data)
    foot = image[-int(20 * MM) :] < 160
    # Lengths of dark runs: where a row changes to dark and back.
    edges = np.diff(np.pad(foot.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    lengths = np.argwhere(edges == -1)[:, 1] - np.argwhere(edges == 1)[:, 1]
    longest = float(lengths.max())
    assert longest / MM == pytest.approx(length_mm, abs=0.25)


def test_cells_leave_no_hairlines() -> None:
    """At a scale where cell edges fall between pixels, ink inside the border stays ink."""
    made = make_sheets([Print(0, 0.1)], "DICT_6X6_1000", A4)
    image = rendered(made.data, dpi=131.7)
    scale = 131.7 / 25.4
    corners = read_back(rendered(made.data), "DICT_6X6_1000")[0]
    (left, top), side = corners[0] * scale, 100 * scale
    module = side / 8
    border = image[int(top + 2) : int(top + module - 2), int(left + 2) : int(left + side - 2)]
    assert border.max() == 0
    ink, _ = ink_cells("DICT_6X6_1000", 0, False)
    for row in range(8):
        for col in range(7):
            if ink[row, col] and ink[row, col + 1]:
                y = int(top + (row + 0.5) * module)
                x = round(left + (col + 1) * module)
                assert image[y, x - 3 : x + 4].max() == 0


@given(hnp.arrays(np.bool_, st.tuples(st.integers(1, 8), st.integers(1, 8))))
def test_outlines_are_the_cells(ink: np.typing.NDArray[np.bool_]) -> None:
    polygons = outlines(ink)
    area = 0
    crossings = np.zeros(ink.shape, dtype=int)
    rows, cols = np.mgrid[: ink.shape[0], : ink.shape[1]] + 0.5
    for polygon in polygons:
        for (x0, y0), (x1, y1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
            area += x0 * y1 - x1 * y0
            assert (x0 == x1) != (y0 == y1)
            if x0 == x1:
                between = (min(y0, y1) < rows) & (rows < max(y0, y1))
                crossings += between & (x0 > cols)
    # Twice the area; every hole is subtracted by its sense.
    assert area == 2 * int(ink.sum())
    np.testing.assert_array_equal(crossings % 2 == 1, ink)


def test_several_on_a_page_are_apart_by_their_quiet_zones() -> None:
    prints = [Print(i, 0.04) for i in range(24)]
    made = make_sheets(prints, "DICT_6X6_1000", A4)
    assert made.pages == 3
    first = read_back(rendered(made.data), "DICT_6X6_1000")
    assert set(first) == set(range(10))
    centres = np.array([corners.mean(axis=0) for corners in first.values()])
    distances = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(distances, np.inf)
    assert distances.min() - 40.0 >= 2 * 40.0 / 8


def test_sizes_of_a_map_are_kept_and_its_places_are_noted() -> None:
    placed = (
        Marker.from_yaw(4, (1.0, -0.0001, 2.5), 0.5, "down", 0.05),
        Marker.from_yaw(9, (0.0, 2.0, 2.5), 0.0, "down", 0.08),
    )
    marker_map = MarkerMap("map", "DICT_4X4_50", placed)
    prints = prints_of_map(marker_map)
    assert prints[0].note == "at 1.000 0.000 2.500 m, faces down, yaw 28.6 deg"
    made = make_sheets(prints, "DICT_4X4_50", A4)
    assert made.pages == 2
    for number, (i, size) in enumerate([(4, 50.0), (9, 80.0)]):
        check_square(read_back(rendered(made.data, number), "DICT_4X4_50")[i], size)
    text = pypdfium2.PdfDocument(made.data)[0].get_textpage().get_text_range()
    assert "id 4 DICT_4X4_50 50 mm" in text
    assert prints[0].note in text


def test_apriltag_sheets_say_how_they_are_drawn() -> None:
    for dictionary, said in (("DICT_APRILTAG_36h11", True), ("DICT_6X6_50", False)):
        data = make_sheets([Print(0, 0.1)], dictionary, A4).data
        text = pypdfium2.PdfDocument(data)[0].get_textpage().get_text_range()
        assert ("180 degrees" in text) == said


def test_the_same_markers_give_the_same_file() -> None:
    first, second = (make_sheets([Print(0, 0.1)], "DICT_6X6_50", A4).data for _ in range(2))
    assert first == second


@given(
    size=st.floats(5.0, 800.0),
    quiet=st.floats(0.0, 0.25),
    inverted=st.booleans(),
    name=st.sampled_from(sorted(PAGES_MM)),
)
def test_layouts_stay_on_the_paper_or_name_one_that_would_do(
    size: float, quiet: float, inverted: bool, name: str
) -> None:
    cell = Cell(size, quiet * size, inverted)
    try:
        layout = lay_out(parse_page(name), cell)
    except ValueError as error:
        advice = str(error).rpartition("; ")[2].removesuffix(" would do").removeprefix("--page ")
        layout = lay_out(parse_page(advice), cell)
        assert advice != name
    for place in range(layout.per_page):
        x, y = layout.corner_mm(place)
        left, top = x + cell.square_mm[0], y + cell.square_mm[1]
        quiet_mm = cell.quiet_mm if inverted else 0.0
        assert left - quiet_mm >= 5.99
        assert top - quiet_mm >= 5.99
        assert left + size + quiet_mm <= layout.page.width_mm - 5.99
        assert y + cell.height_mm <= layout.page.height_mm - 21.99
        assert x >= -1e-9


def test_ids_are_read_as_people_write_them() -> None:
    assert parse_ids("0-3, 7,5") == (0, 1, 2, 3, 7, 5)
    for text in ("", "3-1", "a", "1,,2", "1-", "1,0-3"):
        with pytest.raises(ValueError, match="expected"):
            parse_ids(text)


def test_ids_of_no_dictionary_are_refused_at_once() -> None:
    """The largest that is taken is the largest there is; a slip of the keys builds no list."""
    last = max(len(load_dictionary(name).bytesList) for name in dictionary_names()) - 1
    assert parse_ids(f"{last - 1} - {last}") == (last - 1, last)
    for text in (str(last + 1), "0-99999999", f"5,0-{'9' * 5000}"):
        with pytest.raises(ValueError, match=f"expected ids up to {last}, found '"):
            parse_ids(text)
    with pytest.raises(ValueError, match="expected each id once, found 3 twice"):
        parse_ids("0-5,3-9")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(markers, [str(argument) for argument in arguments])


def test_markers_from_the_command_line(tmp_path: Path) -> None:
    placed = tuple(Marker.from_yaw(i, (i, 0.0, 0.0), 0.0, "up", 0.06) for i in (2, 5))
    site, sheets = tmp_path / "map.yaml", tmp_path / "a.pdf"
    site.write_bytes(map_yaml(MarkerMap("map", "DICT_5X5_50", placed, inverted=True)))
    done = run("--map", site, "--ids", "5", "-o", sheets)
    assert done.exit_code == 0, done.output
    assert done.output.endswith("a.pdf: 1 marker on 1 page of A4\n")
    data = sheets.read_bytes()
    assert set(read_back(rendered(data), "DICT_5X5_50", inverted=True)) == {5}
    again = run("--map", site, "-o", sheets)
    assert isinstance(again.exception, InputError)
    assert "--force" in str(again.exception)
    assert sheets.read_bytes() == data
    assert run("--map", site, "-o", sheets, "--force").exit_code == 0


def test_sheets_of_another_size_than_the_maps_are_told_of(tmp_path: Path) -> None:
    sizes = ((0, 0.15), (1, 0.15), (2, 0.1))
    placed = tuple(Marker.from_yaw(i, (i, 0.0, 0.0), 0.0, "up", size) for i, size in sizes)
    site, sheets = tmp_path / "map.yaml", tmp_path / "a.pdf"
    site.write_bytes(map_yaml(MarkerMap("map", "DICT_5X5_50", placed)))
    done = run("--map", site, "--size-mm", "100", "-o", sheets)
    assert done.exit_code == 0, done.output
    assert done.stderr == (
        f"warning: {site} has markers of 150 mm, printed are 100 mm: "
        "distances are wrong until its size_m is 0.1\n"
    )
    for agreeing in ((), ("--ids", "2", "--size-m", "0.1"), ("--ids", "0-1", "--size-mm", "150")):
        done = run("--map", site, "-o", sheets, "--force", *agreeing)
        assert (done.exit_code, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ids", "0", "--size-mm", "200"], ["A4", "A3 would do"]),
        (["--ids", "0", "--size-mm", "200", "--page", "letter"], ["letter", "tabloid would do"]),
        (["--ids", "50", "--dictionary", "DICT_4X4_50"], ["DICT_4X4_50", "0 to 49", "50"]),
        (["--ids", "0", "--dictionary", "DICT_9X9"], ["DICT_9X9"]),
        (["--ids", "0", "--size-m", "150"], ["187.5 m of paper", "--size-mm is in millimetres"]),
    ],
)
def test_what_cannot_be_printed_is_one_line(
    arguments: list[str], words: list[str], tmp_path: Path
) -> None:
    done = run(*arguments, "-o", tmp_path / "a.pdf")
    assert done.exit_code == 1
    assert len(done.output.splitlines()) == 1
    assert all(word in done.output for word in words), done.output
    assert not list(tmp_path.iterdir())


def test_sizes_in_the_wrong_unit_and_other_files_are_refused(tmp_path: Path) -> None:
    metres = run("--ids", "0", "--size-mm", "0.15", "-o", tmp_path / "a.pdf")
    assert metres.exit_code == 2
    assert "expected markers of 5 mm or more, found 0.15 mm" in metres.output
    picture = run("--ids", "0", "-o", tmp_path / "a.png")
    assert isinstance(picture.exception, InputError)
    assert "expected .pdf, found .png" in str(picture.exception)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_named_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    sheets = tmp_path / "a.pdf"
    failed = run("--ids", "0", "-o", sheets)
    assert isinstance(failed.exception, OSError)
    assert failed.exception.filename == str(sheets)
    assert failed.exception.strerror == "No space left on device"
    assert not list(tmp_path.iterdir())
