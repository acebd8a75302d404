"""A calibration from a source of images: layout, views, lens, with progress."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from recorder.errors import InputError
from replay.calibration.board import Board, Charuco
from replay.calibration.calibrate import Calibration, calibrate
from replay.calibration.corners import charuco_layout
from replay.calibration.frames import Frames
from replay.calibration.lens import Lens
from replay.calibration.marker_size import as_measured
from replay.calibration.views import Gathered, gather
from replay.calibration.wrong_board import wrong_board


@dataclass(frozen=True, eq=False)
class Session:
    """A calibration and where it is from.

    Attributes:
        images: how many the source has.
        looked_at: how many of them, evenly spread, were looked at.
        notes: what a person should know about the source, one line each.
    """

    source: Path
    images: int
    looked_at: int
    calibration: Calibration
    notes: tuple[str, ...]


def calibrate_source(
    source: str | Path,
    board: Board,
    lens: Lens,
    *,
    most_views: int = 60,
    most_frames: int = 1000,
    name: str = "camera",
    progress: bool = True,
) -> Session:
    """The camera that took the images of a log, a folder or a video.

    Args:
        board: a Charuco's layout is found out where it is not given.

    Raises:
        InputError: no such source, or fewer than ten usable views; says what is missing.
    """
    frames = Frames(source, most_frames)
    source = frames.source
    notes = []
    if isinstance(board, Charuco) and board.layout is None:
        looked_through = tqdm(
            frames.images(),
            total=len(frames),
            unit="image",
            desc="layout",
            leave=False,
            disable=None if progress else True,
        )
        layout = charuco_layout(looked_through, board)
        looked_through.close()
        if layout is None:
            notes.append(
                "whether the board has the new or the legacy layout could not be told; new is "
                "assumed"
            )
        board = board.with_layout(layout or "new")
    gathered = _gathered(frames, board, source.name, progress=progress)
    if isinstance(board, Charuco):
        seen = as_measured(board, [view.marker_share for view in gathered.views])
        if seen is not None:
            # Corners are searched for from the markers: with the size given, some would be off by
            # half a pixel and more. The calibration warns of it.
            gathered = _gathered(frames, seen, f"{source.name}, again", progress=progress)
    if frames.warning:
        notes.append(frames.warning)
    if not gathered.views and (hint := wrong_board(frames, board)):
        raise InputError(source, hint)
    with tqdm(total=4, bar_format="{desc}", disable=None if progress else True, leave=False) as bar:
        calibration = calibrate(
            gathered, board, lens, source, most_views=most_views, name=name,
            tick=bar.set_description_str,
        )  # fmt: skip
    return Session(source, frames.total, gathered.looked_at, calibration, tuple(notes))


def _gathered(frames: Frames, board: Board, what: str, *, progress: bool) -> Gathered:
    with tqdm(
        total=len(frames),
        unit="image",
        desc=what,
        disable=None if progress else True,
        file=sys.stderr,
    ) as bar:

        def looked(found: int) -> None:
            bar.set_postfix(views=found, refresh=False)
            bar.update()

        return gather(frames, board, looked)
