"""The live view of a recording, as the recorder takes it."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import click

from pipeline.localizer import PipelineSettings
from recorder.attachments import merge_attachments
from recorder.capture.sink_thread import FrameSink
from recorder.capture.source_thread import is_live
from recorder.log import topics
from recorder.sources.base import CapturedFrame, Source
from replay.live.address import Address, local_viewer, parse_address
from replay.live.child import ViewSetup
from replay.live.view import LiveView


class LiveSink:
    """Hands frames to a view; the recorder counts those that it misses."""

    def __init__(self, view: LiveView, *, counts: bool) -> None:
        """`counts`: what is missed goes into the log; one of a file is the same whoever watches."""
        self._view, self._counts = view, counts

    def __call__(self, frame: CapturedFrame) -> None:
        self._view.offer(frame)

    @property
    def missed(self) -> int:
        return self._view.missed if self._counts else 0


@contextmanager
def live_sink(text: str, source: Source, attachments: Mapping[str, bytes]) -> Iterator[FrameSink]:
    """A sink for the recorder that shows frames at an address (empty: on this machine).

    Raises:
        click.BadParameter: it is none.
        InputError: there is no screen here.
    """
    with live_view(text, source, attachments, PipelineSettings()) as view:
        yield LiveSink(view, counts=is_live(source))


@contextmanager
def live_view(
    text: str, source: Source, attachments: Mapping[str, bytes], settings: PipelineSettings
) -> Iterator[LiveView]:
    """A view of what a source gives; says where it is, and at the end what was shown."""
    address = _address(text)
    files = merge_attachments(source.attachments, attachments)
    missing = [name for name in (topics.CAMERA_FILE, topics.MAP_FILE) if name not in files]
    remark = f"live view at {address}"
    if not address.listens():
        remark += " (nobody listens there yet)"
    if missing:
        remark += f": the image only, without {' and '.join(missing)} there are no poses"
    click.echo(remark, err=True)
    setup = ViewSetup(source.name, uuid.uuid4().hex, files, settings)
    with LiveView(address, setup) as view:
        yield view
    click.echo(view_text(view), err=True)


def view_text(view: LiveView) -> str:
    """One line on what was shown."""
    text = f"live view: {view.shown} frames shown, {view.missed} left out"
    return f"{text}; {view.problem}" if view.problem else text


def _address(text: str) -> Address:
    if not text:
        return local_viewer()
    try:
        return parse_address(text)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--live") from error
