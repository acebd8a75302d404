"""The verb `map`: check, import, export and draw marker maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from recorder.click_types import FiniteFloat

if TYPE_CHECKING:
    from pipeline.markers import MarkerMap
    from recorder.maps.formats import FormatName

_FILE = click.Path(path_type=Path, dir_okay=False)
_LENGTH = FiniteFloat(above=0.0)
_FORMAT = click.Choice(["wpilib", "fiducial_slam", "csv"])


@click.group(
    name="map",
    epilog="""\b
Example:
  arucolog map check map.yaml
""",
)
def map_group() -> None:
    """Check, convert, draw and refine marker maps."""


@map_group.command(
    epilog="""\b
Example:
  arucolog map check map.yaml --strict
"""
)
@click.argument("map_path", metavar="MAP", type=_FILE)
@click.option("--strict", is_flag=True, help="Warnings fail too.")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def check(map_path: Path, strict: bool, as_json: bool) -> None:
    """Say what is odd about a map.yaml: all of it, with a verdict; exit code 1 for errors.

    Errors: what keeps it from being read (ids twice or outside the dictionary, wrong shapes),
    markers that overlap, mirrored ones, impossible sizes and distances. Warnings: markers that are
    tilted, off the others' plane or grid, turned unlike them, of another size or far away; what
    looks like radians, centimetres or millimetres; no room for a quiet zone. With fewer than four
    markers little can be compared, with fewer than eight no grid and no yaw.
    """
    import json

    from recorder.files.yaml_file import read_bytes
    from recorder.maps.check import check_map
    from recorder.maps.check_text import check_text

    found = check_map(read_bytes(map_path), map_path)
    click.echo(json.dumps(found.as_dict(), indent=2) if as_json else check_text(found))
    if not found.sane or (strict and found.count("warning")):
        click.get_current_context().exit(1)


@map_group.command(
    name="import",
    epilog="""\b
Formats:
  wpilib         .json  AprilTagFieldLayout of FRC fields, PhotonVision, Limelight
  fiducial_slam  .txt   the map.txt of ROS's fiducial_slam
  csv            .csv   marker_id, x_m y_m z_m, qx qy qz qw or yaw_deg facing or x0_m ... z3_m
                        (four corners), size_m, std_m, tags

\b
Example:
  arucolog map import 2024-crescendo.json -o map.yaml
""",
)
@click.argument("source", metavar="FILE", type=_FILE)
@click.option("-o", "--output", type=_FILE, required=True, help="The map.yaml.")
@click.option("--format", "name", type=_FORMAT, help="[by the suffix].")
@click.option("--dictionary", help="Of cv2.aruco; no format says it [wpilib: DICT_APRILTAG_36h11].")
@click.option("--size-m", type=_LENGTH, help="Of the black square [wpilib: 0.1651].")
@click.option("--frame", default="map", show_default=True, help="Name of the map frame.")
@click.option("--inverted", is_flag=True, help="The markers are printed white on black.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def import_(
    source: Path,
    output: Path,
    name: FormatName | None,
    dictionary: str | None,
    size_m: float | None,
    frame: str,
    inverted: bool,
    force: bool,
) -> None:
    """Write another tool's map as map.yaml; says what it had to assume.

    AprilTag tools draw their families turned by 180 degrees to OpenCV's drawings: markers of a
    WPILib layout are turned, so that the map is right for tags printed from AprilTag's pictures.
    """
    from recorder.files.map_file import map_yaml
    from recorder.files.output_file import YAML, check_free, check_suffix, write_output
    from recorder.files.yaml_file import read_bytes
    from recorder.info_text import counted
    from recorder.maps.formats import MapDefaults, format_of, import_map

    check_suffix(output, YAML)
    check_free(output, force=force)
    defaults = MapDefaults(dictionary, size_m, frame, inverted)
    found = import_map(read_bytes(source), source, name or format_of(source), defaults)
    write_output(output, map_yaml(found.marker_map), force=force)
    _say(found.notes)
    click.echo(f"{output}: {counted(len(found.marker_map.markers), 'marker')}")


@map_group.command(
    epilog="""\b
Example:
  arucolog map export map.yaml -o markers.csv
"""
)
@click.argument("map_path", metavar="MAP", type=_FILE)
@click.option("-o", "--output", type=_FILE, required=True, help="A .json, .txt or .csv file.")
@click.option(
    "--format", "name", type=_FORMAT, help="As of `map import` [by the suffix of the output]."
)
@click.option(
    "--field-m",
    nargs=2,
    type=_LENGTH,
    metavar="LENGTH WIDTH",
    help="Of the field, for wpilib [as far as the markers reach].",
)
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def export(
    map_path: Path,
    output: Path,
    name: FormatName | None,
    field_m: tuple[float, float] | None,
    force: bool,
) -> None:
    """Write a map.yaml in another tool's format; says what that cannot hold."""
    from recorder.files.map_file import parse_map
    from recorder.files.output_file import check_free, write_output
    from recorder.files.yaml_file import read_bytes
    from recorder.info_text import counted
    from recorder.maps.formats import export_map, format_of

    name = name or format_of(output)
    if field_m is not None and name != "wpilib":
        raise click.UsageError(f"--field-m is for wpilib: leave it out for {name}")
    check_free(output, force=force)
    marker_map = parse_map(read_bytes(map_path), map_path)
    made = export_map(marker_map, map_path, name, field_m)
    write_output(output, made.data, force=force)
    _say(made.notes)
    click.echo(f"{output}: {counted(len(marker_map.markers), 'marker')}, {name}")


@map_group.command(
    epilog="""\b
Example:
  arucolog map draw map.yaml --truth truth.yaml -o plan.svg
"""
)
@click.argument("map_path", metavar="MAP", type=_FILE)
@click.option("-o", "--output", type=_FILE, required=True, help="A .svg, .pdf or .png file.")
@click.option("--truth", type=_FILE, help="Its path and poses are drawn too.")
@click.option("--ids", metavar="IDS", help="Only these, such as 0-23,30: one wall, say.")
@click.option(
    "--scale",
    type=click.IntRange(min=1),
    metavar="N",
    help="1 : N on paper [the largest usual one that fits A3].",
)
@click.option(
    "--view",
    type=click.Choice(["top", "front", "side"]),
    default="top",
    show_default=True,
    help="From above, ceilings too: mirrored to what one sees looking up. Along y or against x, "
    "for walls.",
)
@click.option(
    "--dpi", type=click.IntRange(20, 1200), default=200, show_default=True, help="Of a PNG."
)
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def draw(
    map_path: Path,
    output: Path,
    truth: Path | None,
    ids: str | None,
    scale: int | None,
    view: Literal["top", "front", "side"],
    dpi: int,
    force: bool,
) -> None:
    """Draw a plan to scale: squares, ids, which way is up, std_m, the measured path."""
    from recorder.errors import InputError
    from recorder.files.map_file import parse_map
    from recorder.files.output_file import check_free, write_output
    from recorder.files.truth_file import check_frame, parse_truth
    from recorder.files.yaml_file import read_bytes
    from recorder.info_text import counted
    from recorder.maps.plan import PlanOptions, draw_plan, plan_format

    kind = plan_format(output)
    check_free(output, force=force)
    marker_map = parse_map(read_bytes(map_path), map_path)
    if ids is not None:
        marker_map = _only(marker_map, ids, map_path)
    measured = None
    if truth is not None:
        if view != "top":
            raise click.UsageError("--truth is drawn from above: leave --view out")
        measured = parse_truth(read_bytes(truth), truth)
        check_frame(measured, marker_map, truth)
    options = PlanOptions(scale, view, dpi)
    try:
        plan = draw_plan(marker_map, kind, options, measured, map_path.name)
    except ValueError as error:
        raise InputError(output, str(error)) from error
    write_output(output, plan.data, force=force)
    if plan.hidden:
        others = " or ".join(f"--view {v}" for v in ("top", "front", "side") if v != view)
        click.echo(f"{plan.hidden} markers lie over each other in this view: {others}", err=True)
    click.echo(f"{output}: {counted(len(marker_map.markers), 'marker')}, 1 : {plan.scale}")


def _only(marker_map: MarkerMap, ids: str, map_path: Path) -> MarkerMap:
    from dataclasses import replace

    from recorder.errors import InputError
    from recorder.marker_ids import parse_ids

    try:
        wanted = parse_ids(ids)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--ids") from error
    kept = tuple(marker for marker in marker_map.markers if marker.id in wanted)
    if missing := sorted(set(wanted) - {marker.id for marker in kept}):
        listed = ", ".join(map(str, missing[:10])) + (", …" if len(missing) > 10 else "")
        raise InputError(map_path, f"expected markers with ids {ids}, found none with {listed}")
    return replace(marker_map, markers=kept)


def _say(notes: tuple[str, ...]) -> None:
    for note in notes:
        click.echo(note, err=True)
