"""The verb `markers`: sheets to print."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.click_types import FiniteFloat

_FILE = click.Path(path_type=Path, dir_okay=False)
_LENGTH = FiniteFloat(above=0.0)
_SMALLEST_M = 0.005


@click.command(
    epilog="""\b
Example:
  arucolog markers --ids 0-23 --dictionary DICT_6X6_1000 --size-mm 150 -o sheets.pdf
"""
)
@click.option("--map", "map_path", type=_FILE, help="All markers of a map.yaml, at their sizes.")
@click.option("--ids", metavar="IDS", help="Such as 0-23,30; with --map only these of it.")
@click.option("--dictionary", help="Of cv2.aruco [the map's, else DICT_6X6_1000].")
@click.option("--size-mm", type=_LENGTH, help="Of the black square [the map's, else 150].")
@click.option("--size-m", type=_LENGTH, help="The same in metres.")
@click.option(
    "--page",
    "page_name",
    default="A4",
    show_default=True,
    help="A5 to A0, letter, legal, tabloid, or WIDTHxHEIGHT in mm.",
)
@click.option("--inverted", is_flag=True, help="White on black, as with the map's inverted.")
@click.option(
    "--quiet-modules",
    type=FiniteFloat(above=0.0),
    default=1.0,
    show_default=True,
    help="Width of the quiet zone in cells of the marker.",
)
@click.option("-o", "--output", type=_FILE, required=True, help="The PDF.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def markers(
    map_path: Path | None,
    ids: str | None,
    dictionary: str | None,
    size_mm: float | None,
    size_m: float | None,
    page_name: str,
    inverted: bool,
    quiet_modules: float,
    output: Path,
    force: bool,
) -> None:
    """Make a PDF of markers to print: exact sizes, ids, up arrows, cut marks, a ruler.

    Print at 100 %, without fitting to the page, and measure the ruler and a marker: what counts in
    map.yaml is the size that the printer made. All families are drawn as OpenCV does, to which
    map.yaml refers; AprilTag's own drawings are turned by 180 degrees to that.
    """
    from tqdm import tqdm

    from recorder.files.map_file import parse_map
    from recorder.files.output_file import check_free, check_suffix, write_output
    from recorder.files.yaml_file import read_bytes
    from recorder.info_text import counted
    from recorder.marker_ids import parse_ids
    from recorder.prints.paper import parse_page
    from recorder.prints.sheets import Print, make_sheets, prints_of_map

    if map_path is None and ids is None:
        raise click.UsageError("expected --ids or --map")
    if size_m is not None and size_mm is not None:
        raise click.UsageError("expected --size-mm or --size-m, found both")
    if map_path is not None and dictionary is not None:
        raise click.UsageError("the map says the dictionary: leave --dictionary out")
    other_size = None
    given_m = size_m if size_m is not None else None if size_mm is None else size_mm / 1000.0
    if given_m is not None and given_m < _SMALLEST_M:
        raise click.UsageError(
            f"expected markers of {1000 * _SMALLEST_M:g} mm or more, found {1000 * given_m:g} mm "
            "(--size-mm is in millimetres, --size-m in metres)"
        )
    check_suffix(output, [".pdf"])
    try:
        page = parse_page(page_name)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--page") from error
    try:
        wanted = None if ids is None else parse_ids(ids)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--ids") from error
    check_free(output, force=force)
    if map_path is not None:
        marker_map = parse_map(read_bytes(map_path), map_path)
        prints = prints_of_map(marker_map)
        if wanted is not None:
            by_id = {item.id: item for item in prints}
            if missing := [i for i in wanted if i not in by_id]:
                raise click.ClickException(f"{map_path}: expected id {missing[0]}, found none")
            prints = tuple(by_id[i] for i in wanted)
        if given_m is not None:
            other_size = _other_size_text(map_path, [item.size_m for item in prints], given_m)
            prints = tuple(Print(item.id, given_m, item.note) for item in prints)
        dictionary, inverted = marker_map.dictionary, inverted or marker_map.inverted
    else:
        prints = tuple(Print(i, given_m or 0.15) for i in wanted or ())
    with tqdm(unit="page", desc="markers", disable=None) as bar:
        try:
            made = make_sheets(
                prints,
                dictionary or "DICT_6X6_1000",
                page,
                inverted=inverted,
                quiet_modules=quiet_modules,
                progress=bar.update,
            )
        except ValueError as error:
            raise click.ClickException(str(error)) from error
    write_output(output, made.data, force=force)
    if other_size is not None:
        click.echo(other_size, err=True)
    click.echo(
        f"{output}: {counted(made.markers, 'marker')} on {counted(made.pages, 'page')} "
        f"of {page.name}"
    )


def _other_size_text(map_path: Path, sizes_m: list[float], given_m: float) -> str | None:
    """What the map says of markers that are printed in another size; None where it agrees."""
    others = sorted({f"{1000.0 * size:g}" for size in sizes_m if abs(size - given_m) > 1e-6})
    if not others:
        return None
    shown = ", ".join(others[:5]) + (", …" if len(others) > 5 else "")
    return (
        f"warning: {map_path} has markers of {shown} mm, printed are {1000.0 * given_m:g} mm: "
        f"distances are wrong until its size_m is {given_m:g}"
    )
