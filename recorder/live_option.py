"""The option `--live` of verbs that record; who shows frames is for the program to say."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from copy import copy
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from recorder.capture.sink_thread import FrameSink
    from recorder.sources.base import Source

# Given an address (empty: this machine), the source and what is attached in place of its own.
OpenView = Callable[[str, "Source", Mapping[str, bytes]], AbstractContextManager["FrameSink"]]

LIVE = "--live"


class _Viewer(click.ParamType[str]):
    """The text as it is; a source that was taken for a viewer's address is an error."""

    name = "viewer"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if "/" in value:
            self.fail(
                f"expected HOST or HOST:PORT of a viewer, found {value!r}; SOURCE goes before "
                "--live",
                param,
                ctx,
            )
        return value


def live_option() -> click.Option:
    """`--live [HOST:PORT]`; the command gets the text, empty without an address."""
    return click.Option(
        [LIVE],
        is_flag=False,
        flag_value="",
        type=_Viewer(),
        metavar="[HOST:PORT]",
        help="Show frames in the Rerun viewer of this machine, or of another.",
    )


def with_live(command: click.Command, open_view: OpenView) -> click.Command:
    """A verb that takes `live: View`, with that option."""
    option = live_option()
    option.callback = lambda context, parameter, text: View(open_view, text)
    return with_option(command, option)


def with_option(command: click.Command, option: click.Option) -> click.Command:
    """A copy of a command that has one option more."""
    changed = copy(command)
    changed.params = [*command.params, option]
    return changed


class View:
    """What was asked for with `--live`, if anything."""

    def __init__(self, open_view: OpenView | None = None, text: str | None = None) -> None:
        self._open_view, self._text = open_view, text

    @contextmanager
    def sinks(
        self, source: Source, attachments: Mapping[str, bytes]
    ) -> Iterator[tuple[FrameSink, ...]]:
        """The sinks for a recording of `source`."""
        if self._open_view is None or self._text is None:
            yield ()
            return
        with self._open_view(self._text, source, attachments) as sink:
            yield (sink,)
