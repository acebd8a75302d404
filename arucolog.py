"""The command `arucolog`: every package's verbs under one name, and errors as one line."""

from __future__ import annotations

import sys

import click

import analysis.cli
import recorder.cli
import replay.cli
from recorder.errors import InputError
from replay.track_cli import open_view


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="arucolog", message="arucolog %(version)s")
def cli() -> None:
    """Localize a mobile robot with one camera and ArUco markers: record, replay, compare, look."""


for command in (*recorder.cli.commands(live=open_view), *replay.cli.commands()):
    cli.add_command(command)
for command in analysis.cli.commands():
    cli.add_command(command)


def main() -> None:
    """The command line. Exit code 0: done, 1: failed, 2: wrong usage, 130: interrupted."""
    if "" in sys.argv[1:]:
        # An unset variable of a script; as a path it would be the folder one is in.
        click.echo("Error: expected no empty argument, found one", err=True)
        sys.exit(2)
    try:
        code = cli.main(standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else "")
        code = 2
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("Interrupted.", err=True)
        code = 130
    except BrokenPipeError:
        code = 1
    except InputError as error:
        click.echo(f"Error: {error}", err=True)
        code = 1
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        click.echo(f"Error: {place}{error.strerror or error}", err=True)
        code = 1
    sys.exit(code)


if __name__ == "__main__":
    main()
