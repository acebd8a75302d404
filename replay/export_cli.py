"""The verb `export`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from replay.export import Format


def export() -> click.Command:
    return _export


@click.command(
    "export",
    epilog="""\b
Example:
  arucolog export logs/sample.results/default-* --format tum --tracker adaptive -o adaptive.tum
""",
)
@click.argument("result", metavar="RESULT", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "format_",
    type=click.Choice(["tum", "kitti", "csv", "mcap"]),
    required=True,
    help="tum: `t x y z qx qy qz qw`, as evo reads it; kitti: 3x4 matrices, without times; csv: "
    "all columns; mcap: for Foxglove and Rerun.",
)
@click.option(
    "--tracker",
    metavar="NAME",
    help="A tracker, `fixes` or `truth` [the first tracker; in an mcap all].",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File [RESULT/NAME.SUFFIX].",
)
@click.option("--force", is_flag=True, help="Replace a file that exists.")
def _export(
    result: Path, format_: Format, tracker: str | None, output: Path | None, force: bool
) -> None:
    """Write a result's trajectory for other tools: the camera's pose in the map, frame by frame.

    A tracker knows x and y only; z and orientation are those of the frame's fix, or of the last
    one where a frame has none. Frames without a pose are left out: those before the first fix, for
    `fixes` all that were rejected. KITTI files have no times, so that a hole moves what follows.

    An mcap has PoseInFrame on /fix, /track/NAME and /truth/exact, and FrameTransform from the map
    to `camera`, which follows the tracker given (else the first).
    """
    from recorder.errors import InputError
    from recorder.files.output_file import check_suffix
    from replay.export import FILE_SUFFIX, SUFFIXES
    from replay.export import export as write
    from replay.result import open_result

    check_suffix(output, SUFFIXES[format_])
    opened = open_result(result)
    if output is None:
        first = next(iter(opened.settings.trackers))
        name = tracker or ("trajectories" if format_ == "mcap" else first)
        output = result / f"{name}{FILE_SUFFIX[format_]}"
    if output.exists() and not force:
        raise InputError(output, "expected a new file, found one that exists (--force replaces it)")
    for exported in write(opened, format_, tracker, output):
        left_out = f", {exported.left_out} frames without" if exported.left_out else ""
        click.echo(f"{output}: {exported.name}, {len(exported.table)} poses{left_out}")
