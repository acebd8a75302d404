"""Makes the sample in logs/ and the README's picture of it again: `make sample`."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2

from recorder.record import record
from recorder.sources.opening import open_source
from replay.run import ReplayOptions, replay
from replay.settings_file import load_settings
from replay.viewer.program import has_graphics
from replay.viewer.screenshot import screenshot

LOGS = Path(__file__).resolve().parents[1] / "logs"
LOG = LOGS / "sample.mcap"
SETTINGS = LOGS / "sample.settings.yaml"
EXPECTED = LOGS / "sample.expected.json"
PICTURE = LOGS.parent / "docs" / "viewer.png"
MENU_PX = 36


def replayed(folder: Path) -> dict[str, Any]:
    """What a replay of the sample gives, without what differs from run to run."""
    options = ReplayOptions(settings=load_settings(SETTINGS), rrd=False, progress=False)
    summary = replay(LOG, folder / "sample", "sample", options)
    return {key: summary[key] for key in ("frames", "status", "fallback", "log_sha256", "errors")}


def main() -> None:
    # The machine that it is made on is nobody's business.
    session = dict.fromkeys(("host", "platform", "git"), "-")
    record(open_source("sample"), LOG, force=True, session=session)
    with TemporaryDirectory() as folder:
        expected = replayed(Path(folder))
    EXPECTED.write_text(json.dumps(expected, indent=1) + "\n")
    print(f"{LOG}: {LOG.stat().st_size / 1e6:.1f} MB\n{EXPECTED}")
    if has_graphics():
        with TemporaryDirectory() as folder:
            picture(Path(folder))
        print(PICTURE)


def picture(folder: Path) -> None:
    """The README's picture of a replay, without the viewer's menu."""
    options = ReplayOptions(settings=load_settings(SETTINGS), progress=False)
    replay(LOG, folder / "sample", "sample", options)
    problems = screenshot(folder / "sample/replay.rrd", PICTURE, at_frame=75)
    if problems:
        raise RuntimeError("; ".join(problems))
    image = cv2.imread(str(PICTURE))
    assert image is not None
    cv2.imwrite(str(PICTURE), image[MENU_PX:], [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
