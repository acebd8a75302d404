"""The verb `recover`."""

from __future__ import annotations

from pathlib import Path

import click

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(
    epilog="""\b
Example:
  arucolog recover logs/drive.mcap -o logs/drive-recovered.mcap
"""
)
@click.argument("log", type=_FILE)
@click.option("-o", "--output", type=_FILE, required=True, help="The log to make.")
@click.option("--force", is_flag=True, help="Replace a log that exists, but never LOG.")
@click.option("--json", "as_json", is_flag=True, help="What was saved, as JSON.")
def recover(log: Path, output: Path, force: bool, as_json: bool) -> None:
    """Save what can be read of a log that was cut short (a power loss, a kill) or is damaged.

    The new log is whole: it has its index, and counts of what is in it, as far as that shows
    without decoding images (verify does). LOG itself stays as it is.
    """
    import json

    from recorder.files.output_file import LOG, check_suffix
    from recorder.info_text import counted
    from recorder.recover import recover as recover_log

    check_suffix(output, LOG)
    found = recover_log(log, output, force=force)
    if as_json:
        click.echo(json.dumps(found.as_dict(), indent=2))
        return
    frames = counted(found.counts.written, "frame")
    click.echo(f"{output}: {frames}, {found.duration_s:.3f} s, {found.counts.dropped} missing")
    if not found.counts.written:
        kept = ", ".join(found.attachments) or "all else that was in it"
        click.echo(f"no images could be read: what is saved is {kept}", err=True)
    for piece in found.damage:
        click.echo(f"left out: {piece}")
    problem = found.problem
    click.echo(f"the log was {problem}" if problem else "nothing was wrong with the log")
