"""The verb `verify`."""

from __future__ import annotations

from pathlib import Path

import click

from recorder.verify.limits import CORRUPT_PERCENT, IRREGULAR_PERCENT, LOST_PERCENT

_FILE = click.Path(path_type=Path, dir_okay=False)
_HELP = f"""Check logs against rules, and say whether they can be trusted.

Parts of one recording are checked together. Exit code 1 if a rule failed.

\b
A rule fails if trajectories or statistics of the log could be wrong:
  end          the log was cut short, and has no end
  parts        a part between the others is missing
  checksums, index, counts
               what is there is not what was written
  gaps         more than {LOST_PERCENT:g} % of the frames are lost, by number or
               in pauses; or frame numbers do not increase
  stamps       captures jump back, or more than {IRREGULAR_PERCENT:g} % stand still
  rate         more than {IRREGULAR_PERCENT:g} % of the intervals are off by half of
               one or more
  images       there are none, or more than {CORRUPT_PERCENT:g} % are corrupt or of
               another size
  calibration, map, truth
               a file is malformed or contradicts the images or the map

Less than that is a warning, something to know before you use the log. So are a recording that a
full disk or a lost camera ended, or that has more parts before or after; frames that came late or
at another rate for a while; and a log without calibration or map.
"""


@click.command(
    help=_HELP,
    epilog="""\b
Example:
  arucolog verify logs/sample.mcap
""",
)
@click.argument("logs", metavar="LOG...", nargs=-1, required=True, type=_FILE)
@click.option("--quick", is_flag=True, help="Look at images' headers only, decode none.")
@click.option("--json", "as_json", is_flag=True, help="Every rule's verdict as JSON.")
def verify(logs: tuple[Path, ...], quick: bool, as_json: bool) -> None:
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
