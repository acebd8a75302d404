"""What `arucolog info` tells of a recording's events, counts and end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from recorder.cli import commands
from recorder.info import LogInfo, log_info
from recorder.info_text import info_text
from recorder.log.writer import LogWriter
from tests.log_helpers import frame

COUNTED = {
    "frames_dropped": "3",
    "frames_late": "17",
    "frames_corrupt": "0",
    "frames_inspected": "30",
    "frames_stamped_back": "1",
    "connection_lost": "2",
    "connection_lost_s": "4.5",
    "connection_lost_at_end": "yes",
}


def log_with(
    path: Path,
    *,
    warnings: int = 0,
    marks: int = 0,
    ended: str = "complete",
    said: dict[str, str] | None = None,
) -> LogInfo:
    """Two frames, warnings of the recorder, then marks."""
    with LogWriter(path, attachments={}, session={}) as writer:
        writer.write_frame(frame(0))
        for i in range(warnings):
            writer.write_event(frame(0).timestamp_ns, "info", f"something {i}")
        for i in range(marks):
            stamp_ns = frame(0).timestamp_ns
            writer.write_event(stamp_ns, "info", f"arrived at {i}", name="operator")
        writer.write_frame(frame(1))
        writer.end_as(ended, **(said or {}))
    return log_info(path)


def rows(info: LogInfo, name: str) -> list[str]:
    lines = [line.split(maxsplit=1) for line in info_text(info).splitlines()]
    return [line[1] for line in lines if line[0] == name]


def test_events_beyond_the_first_ten_are_counted(tmp_path: Path) -> None:
    assert len(rows(log_with(tmp_path / "ten.mcap", warnings=10), "event")) == 10
    found = rows(log_with(tmp_path / "more.mcap", warnings=150), "event")
    assert len(found) == 11
    assert found[-1] == "... 150 in all"


def test_no_mark_is_left_out(tmp_path: Path) -> None:
    """Behind more events than are kept."""
    info = log_with(tmp_path / "log.mcap", warnings=150, marks=12)
    found = rows(info, "event")
    assert [text.split()[-1] for text in found[10:-1]] == [str(i) for i in range(12)]
    assert found[-1] == "... 162 in all"
    assert [event["by"] for event in info.events[-12:]] == ["operator"] * 12


def test_what_the_recorder_counted(tmp_path: Path) -> None:
    info = log_with(tmp_path / "log.mcap", said=COUNTED)
    assert rows(info, "recorded") == [
        "3 dropped, 17 late, 1 with a stamp that jumps back, 30 decoded to look for damage, "
        "connection lost 2 times, for 4.5 s in all, and not back at the end"
    ]
    command = {c.name: c for c in commands()}["info"]
    done = CliRunner().invoke(command, [str(tmp_path / "log.mcap"), "--json"])
    told = json.loads(done.output)["recorded"]
    assert {name: told[name] for name in COUNTED} == {
        "frames_dropped": 3,
        "frames_late": 17,
        "frames_corrupt": 0,
        "frames_inspected": 30,
        "frames_stamped_back": 1,
        "connection_lost": 2,
        "connection_lost_s": 4.5,
        "connection_lost_at_end": True,
    }


def test_a_recording_without_faults_has_no_line_for_them(tmp_path: Path) -> None:
    assert rows(log_with(tmp_path / "log.mcap"), "recorded") == []
    said = {"connection_lost": "x", "connection_lost_s": "", "connection_lost_at_end": "?"}
    assert rows(log_with(tmp_path / "odd.mcap", said=said), "recorded") == []


@pytest.mark.parametrize(
    ("ended", "text"),
    [
        ("complete", "complete"),
        ("interrupted", "interrupted"),
        ("disk_low", "cut short when it was recorded: the disk was nearly full"),
        ("disk_full", "cut short when it was recorded: the disk was full"),
        ("error: no light", "cut short when it was recorded: no light"),
    ],
)
def test_how_it_ended_is_told_in_words(tmp_path: Path, ended: str, text: str) -> None:
    info = log_with(tmp_path / "log.mcap", ended=ended)
    assert rows(info, "ended") == [text]
    assert info.as_dict()["ended"] == ended
