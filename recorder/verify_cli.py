"""The verb `verify`."""

from __future__ import annotations

from pathlib import Path

import click

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(
    epilog="""\b
Example:
  arucolog verify logs/sample.mcap
"""
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=_FILE)
@click.option("--quick", is_flag=True, help="Look at images' headers only, decode none.")
@click.option("--json", "as_json", is_flag=True, help="Every rule's verdict as JSON.")
def verify(logs: tuple[Path, ...], quick: bool, as_json: bool) -> None:
    """Check logs against rules: end, checksums, index, counts, gaps, times, images, calibration...

    Parts of one recording are checked together. Exit code 1 if a rule failed; warnings are what you
    should know before you trust the log.
    """
    import json

    from tqdm import tqdm

    from recorder.log.parts import group_parts
    from recorder.verify.run import verdict_text
    from recorder.verify.run import verify as verify_log

    verdicts = []
    for group in group_parts(logs, lambda text: click.echo(f"Warning: {text}", err=True)):
        with tqdm(unit="frame", desc=group[0].name, disable=None, leave=False) as bar:
            verdict = verify_log(group, decode=not quick, on_image=bar.update)
        verdicts.append(verdict)
        if not as_json:
            click.echo(verdict_text(verdict))
    if as_json:
        click.echo(json.dumps([verdict.as_dict() for verdict in verdicts], indent=2))
    if any(verdict.level == "failed" for verdict in verdicts):
        click.get_current_context().exit(1)
