"""The verb `truth`: write, check and time the ground truth that was measured by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.click_types import FiniteFloat

if TYPE_CHECKING:
    from recorder.bench.marks import Mark
    from recorder.files.truth_file import Truth
    from recorder.log.reader import LogReader

_FILE = click.Path(path_type=Path, dir_okay=False)
_NUMBER = FiniteFloat()
_LENGTH = FiniteFloat(above=0.0)


@click.group(
    name="truth",
    epilog="""\b
Example:
  arucolog truth check truth.yaml --map map.yaml
""",
)
def truth_group() -> None:
    """Write, check and time the ground truth that was measured by hand."""


@truth_group.command(
    epilog="""\b
Rows and columns count the lines of the floor; 0,0 is the crossing at --origin-m, halves are middles
of squares. Columns go where --yaw-deg says (0: along map x), rows to the left of that, headings
count from the columns' direction to the left, and are those of the camera's x axis. A point that
begins with a minus sign needs a name: a=-1,2.

\b
Example:
  arucolog truth floor --square-m 1/6 --z-m 1.334 0,0,0 0,18,90 12,18,180 12,0,270 \\
    --path "0,0 0,18 12,18 12,0" --closed -o truth.yaml
"""
)
@click.argument("points", metavar="[[NAME=]ROW,COL[,HEADING]]...", nargs=-1)
@click.option("--square-m", required=True, metavar="SIDE", help="Of a square: 0.25, or 1/6.")
@click.option(
    "--origin-m", default="0,0", metavar="X,Y", show_default=True, help="Map place of 0,0."
)
@click.option(
    "--yaw-deg", type=_NUMBER, default=0.0, show_default=True, help="Map heading of the columns."
)
@click.option("--z-m", type=_NUMBER, help="Height of the camera on this floor.")
@click.option(
    "--std-m", type=_LENGTH, default=0.005, show_default=True, help="Uncertainty of the points."
)
@click.option("--path", "driven", metavar="'ROW,COL ...'", help="A path that is driven.")
@click.option("--closed", is_flag=True, help="Its last point joins the first.")
@click.option(
    "--path-std-m", type=_LENGTH, default=0.05, show_default=True, help="How far from the path."
)
@click.option("--frame", default="map", show_default=True, help="As in the map.")
@click.option("--method", default="", help="In words [chessboard floor, ...].")
@click.option("-o", "--output", type=_FILE, required=True, help="The truth.yaml.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def floor(
    points: tuple[str, ...],
    square_m: str,
    origin_m: str,
    yaw_deg: float,
    z_m: float | None,
    std_m: float,
    driven: str | None,
    closed: bool,
    path_std_m: float,
    frame: str,
    method: str,
    output: Path,
    force: bool,
) -> None:
    """Write a truth.yaml from rows and columns of a chessboard floor.

    The points are its waypoints, in the order in which they are reached; without names they are
    1, 2, 3, ... While a live camera records, keys mark when the camera is there.
    """
    from recorder.bench import floor_file
    from recorder.files.output_file import YAML, check_free, check_suffix, write_output
    from recorder.files.truth_entries import FloorEntry, truth_yaml
    from recorder.files.truth_file import parse_truth
    from recorder.info_text import counted

    if closed and driven is None:
        raise click.UsageError("expected --path with --closed")
    check_suffix(output, YAML)
    check_free(output, force=force)
    try:
        side = floor_file.parse_square(square_m)
        origin = floor_file.parse_numbers(origin_m, (2,), "X,Y in metres")
        entry = FloorEntry(square_m=side, origin_m=origin, yaw_deg=yaw_deg, z_m=z_m)
        waypoints = floor_file.waypoints(points, std_m)
        path = None
        if driven is not None:
            path = floor_file.path(driven, entry, closed=closed, std_m=path_std_m)
        file = floor_file.floor_truth(entry, waypoints, path, frame=frame, method=method)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    data = truth_yaml(file)
    truth = parse_truth(data, output)
    write_output(output, data, force=force)
    click.echo(
        f"{output}: {counted(len(truth.waypoints), 'waypoint')}"
        + (f", path of {len(truth.path.points_m)} points" if truth.path else "")
    )


@truth_group.command(
    epilog="""\b
Example:
  arucolog truth check truth.yaml --map map.yaml --strict
"""
)
@click.argument("truth_path", metavar="TRUTH", type=_FILE)
@click.option("--map", "map_path", type=_FILE, help="Where the markers are, map.yaml [the log's].")
@click.option(
    "--log", "logs", type=_FILE, multiple=True, help="The recording; may be repeated for its parts."
)
@click.option("--strict", is_flag=True, help="Warnings fail too.")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
def check(
    truth_path: Path, map_path: Path | None, logs: tuple[Path, ...], strict: bool, as_json: bool
) -> None:
    """Say what is odd about a truth file: all of it, with a verdict; exit code 1 for errors.

    Errors: what keeps it from being read, another frame than the map's, places that no marker is
    seen from, or that are in another unit, times after the log's end. Warnings: places outside of
    the markers' extent or off the path, headings unlike the others or in radians, speeds no robot
    has, uncertainties no hand has, a rounded square size, marks without a waypoint, times without
    an image.
    """
    import json

    from recorder.bench.check.run import check_text, check_truth
    from recorder.bench.check.time_rules import log_times
    from recorder.errors import InputError
    from recorder.files.map_file import parse_map
    from recorder.files.yaml_file import read_bytes

    data = read_bytes(truth_path)
    if map_path is None and not logs:
        raise click.UsageError("expected --map, or --log with a map in it")
    times = None
    marker_map = None if map_path is None else parse_map(read_bytes(map_path), map_path)
    if logs:
        log = _one_log(logs)
        times = log_times(log)
        marker_map = marker_map or log.marker_map()
        if marker_map is None:
            raise InputError(logs[0], "expected a marker map, found none; give one with --map")
    if marker_map is None:
        return
    found = check_truth(data, truth_path, marker_map, times)
    click.echo(json.dumps(found.as_dict(), indent=2) if as_json else check_text(found))
    if not found.sane or (strict and found.count("warning")):
        click.get_current_context().exit(1)


@truth_group.command(
    epilog="""\b
Example:
  arucolog truth marks logs/drive.mcap --truth truth.yaml -o truth-timed.yaml
"""
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=_FILE)
@click.option("--truth", "truth_path", type=_FILE, help="With the waypoints [the log's].")
@click.option("-o", "--output", type=_FILE, help="A truth.yaml with timed poses.")
@click.option("--json", "as_json", is_flag=True, help="The marks and poses as JSON.")
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def marks(
    logs: tuple[Path, ...],
    truth_path: Path | None,
    output: Path | None,
    as_json: bool,
    force: bool,
) -> None:
    """Say what was marked in a log (its parts), and turn it into timed poses.

    A replay does so by itself, with the log's truth or with --truth. A file that is written here
    can be edited: it has the waypoints as poses with from_s and to_s, and needs no marks.
    """
    import json
    from dataclasses import asdict

    from recorder.bench.check.time_rules import frame_findings, log_times
    from recorder.bench.timed_file import timed_truth
    from recorder.bench.timing import with_marks
    from recorder.errors import InputError
    from recorder.files.output_file import YAML, check_free, check_suffix, write_output
    from recorder.files.truth_entries import truth_yaml
    from recorder.files.truth_file import parse_truth
    from recorder.files.yaml_file import read_bytes

    check_suffix(output, YAML)
    if output is not None:
        check_free(output, force=force)
    log = _one_log(logs)
    times = log_times(log)
    found = times.marks
    truth: Truth | None = None
    if truth_path is not None:
        truth = parse_truth(read_bytes(truth_path), truth_path)
    else:
        truth = log.truth()
    problems: tuple[str, ...] = ()
    if truth is not None and truth.waypoints:
        truth, problems = with_marks(truth, found)
        unseen = frame_findings(truth, times.frames_s)
        problems = (*problems, *(finding.text for finding in unseen))
    elif output is not None:
        where = truth_path or logs[0]
        raise InputError(where, "expected a truth with waypoints, found none; give one: --truth")
    if output is not None and truth is not None and not truth.poses:
        raise InputError(logs[0], "expected marks of the truth's waypoints, found none")
    if as_json:
        poses = [] if truth is None else [asdict(pose) for pose in truth.poses]
        content = {
            "marks": [mark.as_dict() for mark in found],
            "poses": poses,
            "problems": problems,
        }
        click.echo(json.dumps(content, indent=2))
    else:
        click.echo(_marks_table(found) or "no marks")
    for problem in problems:
        click.echo(f"Warning: {logs[0]}: {problem}", err=True)
    if output is not None and truth is not None:
        data = truth_yaml(timed_truth(truth), f"Timed by the marks in {logs[0].name}.")
        parse_truth(data, output)
        write_output(output, data, force=force)
        click.echo(f"{output}: {len(truth.poses)} timed poses", err=as_json)


def _one_log(paths: tuple[Path, ...]) -> LogReader:
    """One log, or the parts of one recording in whatever order."""
    from recorder.log.parts import group_parts, open_log

    groups = group_parts(paths, lambda text: click.echo(f"Warning: {text}", err=True))
    if len(groups) > 1:
        raise click.UsageError("expected one log, or the parts of one recording, found several")
    return open_log(groups[0])


def _marks_table(found: tuple[Mark, ...]) -> str:
    rows = []
    for mark in found:
        to_s = "not ended" if mark.to_s is None else f"{mark.to_s:.3f} s"
        span = f"{mark.from_s:.3f} s" + (f" to {to_s}" if mark.stood else "")
        what = "stood at" if mark.stood else "arrived at"
        rows.append((f"{what} {mark.name}", span + (", undone" if mark.undone else "")))
    width = max((len(what) for what, _ in rows), default=0)
    return "\n".join(f"{what:<{width}}  {span}" for what, span in rows)
