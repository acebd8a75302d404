"""The verb `calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pipeline.camera import DistortionModel
    from replay.calibration.board import Board
    from replay.calibration.lens import Lens

_FILE = click.Path(path_type=Path, dir_okay=False)


def calibrate() -> click.Command:
    return _calibrate


@click.command(
    "calibrate",
    epilog="""\b
Example:
  arucolog calibrate board-pictures --board chessboard:9x6:0.025 -o camera.yaml
""",
)
@click.argument("source", metavar="LOG|FOLDER|VIDEO", type=click.Path())
@click.option(
    "--board",
    "board_text",
    required=True,
    metavar="BOARD",
    help="chessboard:COLSxROWS:SQUARE_M, by inner corners, or "
    "charuco:COLSxROWS:SQUARE_M:MARKER_M:DICTIONARY[:new|:legacy], by squares; the layout is "
    "found out if it is not given.",
)
@click.option(
    "--model",
    type=click.Choice(["plumb_bob", "rational_polynomial", "equidistant"]),
    default="plumb_bob",
    show_default=True,
    help="Of the distortion; equidistant for fisheye lenses.",
)
@click.option(
    "--zero",
    multiple=True,
    metavar="COEFFICIENT",
    help="Leave a coefficient (such as k3) at zero; may be repeated.",
)
@click.option(
    "-o",
    "--output",
    type=_FILE,
    default=Path("camera.yaml"),
    show_default=True,
    help="The calibration; the report goes beside it, as .html.",
)
@click.option("--report", "report_path", type=_FILE, help="The report [OUTPUT's name, .html].")
@click.option("--name", default="camera", show_default=True, help="The camera's name in the file.")
@click.option(
    "--max-views",
    type=click.IntRange(min=10),
    default=60,
    show_default=True,
    help="Use at most so many views, those that differ most.",
)
@click.option(
    "--max-frames",
    type=click.IntRange(min=10),
    default=1000,
    show_default=True,
    help="Look at no more images than these, evenly spread.",
)
@click.option("--force", is_flag=True, help="Replace files that exist.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def _calibrate(
    source: str,
    board_text: str,
    model: DistortionModel,
    zero: tuple[str, ...],
    output: Path,
    report_path: Path | None,
    name: str,
    max_views: int,
    max_frames: int,
    force: bool,
    as_json: bool,
) -> None:
    """Calibrate a camera from pictures of a chessboard or a ChArUco board.

    Takes the sharp views that differ, at least ten, leaves out those that do not fit the others,
    and writes camera.yaml with a report: errors of each view, also when it is held out, coverage of
    the image, standard deviations. Warns where the calibration should not be trusted.
    """
    import json

    from recorder.files.output_file import HTML, YAML, check_free, check_suffix, write_together
    from replay.calibration import report as reports
    from replay.calibration.picture import picture
    from replay.calibration.session import calibrate_source

    board, lens = _board(board_text), _lens(model, zero)
    page = report_path or output.with_suffix(".html")
    check_suffix(output, YAML)
    check_suffix(page, HTML)
    for path in (output, page):
        check_free(path, force=force)
    session = calibrate_source(
        source, board, lens, most_views=max_views, most_frames=max_frames, name=name
    )
    report = reports.as_dict(session)
    # A calibration without its report says nothing about itself.
    files = {
        page: reports.as_page(report, picture(session.calibration)).encode(),
        output: reports.camera_file(session.calibration, report),
    }
    write_together(files, force=force)
    if as_json:
        paths = {"camera_yaml": str(output), "report": str(page)}
        click.echo(json.dumps({**paths, **report}, indent=2, allow_nan=False))
    else:
        click.echo(f"{reports.as_text(report)}\n  {output}, {page}")
    for warning in report["warnings"]:
        click.echo(f"Warning: {warning}", err=True)


def _board(text: str) -> Board:
    from replay.calibration.board import parse_board

    try:
        return parse_board(text)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--board") from error


def _lens(model: DistortionModel, zero: tuple[str, ...]) -> Lens:
    from replay.calibration.lens import Lens

    try:
        return Lens(model, frozenset(zero))
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--zero") from error
