"""Marks of waypoints: their text, what the keys make of them, and the poses of a replay."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.bench.clock import CaptureClock, WatchedSource
from recorder.bench.keys import HELP, KeyInput
from recorder.bench.marking import Marking
from recorder.bench.marks import Mark, MarkReader, log_marks
from recorder.bench.timing import ARRIVAL_S, timed_marks, with_marks
from recorder.capture.notes import Notes
from recorder.capture.parts import SplitLimit
from recorder.files.truth_file import StoodPose, Truth, Waypoint
from recorder.info import log_info
from recorder.info_text import info_text
from recorder.log.parts import open_log
from recorder.log.reader import LogReader
from recorder.log.records import LogEvent
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.sources.base import CapturedFrame, SourceEvent
from recorder.sources.live import clock as live_clock
from replay.inputs import Overrides
from replay.run import ReplayOptions, replay
from tests import worlds
from tests.log_helpers import frame

START_NS = 1_700_000_000_000_000_000


class Desk:
    """An operator before a camera that gives a frame each millisecond, with a clock to set."""

    def __init__(self, *names: str) -> None:
        self.notes = Notes()
        self.clock = CaptureClock(live_clock.ARRIVAL)
        self.marking = Marking(self.notes, self.clock, names)
        self.input = KeyInput(self.marking)

    def type(self, at_s: float, text: str) -> str:
        """Keys at a second of the log; what was said about the last one."""
        now_ns = START_NS + round(at_s * 1e9)
        for stamp_ns in (START_NS, now_ns):
            self.clock.see(stamp_ns, stamp_ns)
        return ["", *self.input.feed(text, now_ns)][-1]

    def written(self) -> list[tuple[float, str]]:
        """Seconds of the log and texts of the events so far."""
        return [((n.timestamp_ns - START_NS) / 1e9, n.message) for n in self.notes.take()]


def read(written: list[tuple[float, str]]) -> tuple[Mark, ...]:
    reader = MarkReader(START_NS)
    for at_s, text in written:
        reader.add(START_NS + round(at_s * 1e9), text)
    return reader.marks


def test_the_marks_of_a_session_by_hand() -> None:
    desk = Desk()
    desk.type(1.0, "3\r")
    desk.type(2.5, "s")
    desk.type(7.25, "s")
    desk.type(9.0, "n")
    desk.type(9.5, "u")
    desk.type(10.0, "wdoor\r")
    desk.type(11.0, "t arrived at 9 \r")
    written = desk.written()
    assert written == [
        (1.0, "arrived at 3"),
        (2.5, "standing still at 3 from 2.500"),
        (7.25, "standing still at 3 from 2.500 to 7.250"),
        (9.0, "arrived at 4"),
        (9.5, "undone: arrived at 4 at 9.000"),
        (10.0, "arrived at door"),
        (11.0, "note: arrived at 9"),
    ]
    assert read(written) == (
        Mark("3", 1.0, 1.0, stood=False),
        Mark("3", 2.5, 7.25, stood=True),
        Mark("4", 9.0, 9.0, stood=False, undone=True),
        Mark("door", 10.0, 10.0, stood=False),
    )


def test_names_of_the_truth_file_give_the_order_and_the_spelling() -> None:
    desk = Desk("1", "A2", "3")
    assert [desk.type(i, "n").split()[2] for i in (1, 2, 3, 4)] == ["1", "A2", "3", "1"]
    assert desk.type(5, "p").startswith("arrived at 3 at 5.000")
    assert desk.type(6, "wa2\r") == "arrived at A2 at 6.000"
    assert desk.type(7, "9\r") == "arrived at 9 at 7.000 (not in truth.yaml)"


def test_typing_can_be_corrected_and_left() -> None:
    desk = Desk()
    assert desk.type(1, "12\x7f3\r") == "arrived at 13 at 1.000"
    assert desk.type(2, "4\x1b") == ""
    assert desk.input.entry is None
    assert desk.type(3, "5\x7f") == ""
    desk.type(3, "\x7f")
    assert desk.input.entry is None
    # An arrow key is no Esc, A or B.
    assert desk.type(4, "6\x1b[A\r") == "arrived at 6 at 4.000"
    assert "one word" in desk.type(5, "wa b\r")
    assert desk.type(6, "w\r") == ""
    assert desk.type(7, "?") == HELP
    assert "no key" in desk.type(8, "y")
    assert [text for _, text in desk.written()] == ["arrived at 13", "arrived at 6"]


def test_nothing_is_marked_before_the_first_image_or_without_a_place() -> None:
    desk = Desk()
    assert "no image" in "".join(desk.input.feed("3\r", START_NS))
    assert "no image" in "".join(desk.input.feed("s", START_NS))
    assert "which waypoint" in desk.type(1, "s")
    assert desk.type(1, "u") == "nothing to undo"
    assert desk.written() == []


def test_who_is_elsewhere_did_not_stand_still_until_now() -> None:
    desk = Desk()
    desk.type(1, "1\rs")
    assert "not ended" in desk.type(9, "2\r")
    assert read(desk.written()) == (
        Mark("1", 1.0, 1.0, stood=False),
        Mark("1", 1.0, None, stood=True, undone=True),
        Mark("2", 9.0, 9.0, stood=False),
    )
    desk.type(10, "s")
    assert "already" in desk.type(11, "2\r")
    desk.type(12, "s")
    assert read(desk.written()) == (Mark("2", 10.0, 12.0, stood=True),)


def test_undo_goes_back_through_all_marks() -> None:
    desk = Desk()
    desk.type(1, "1\r")
    desk.type(2, "s")
    desk.type(3, "s")
    desk.type(4, "2\r")
    desk.type(5, "s")
    for at_s in (6, 7, 8, 9):
        desk.type(at_s, "u")
    assert desk.type(10, "u") == "nothing to undo"
    assert all(mark.undone for mark in read(desk.written()))
    assert "which waypoint" in desk.type(11, "s")


def test_standing_still_ends_with_the_last_frame() -> None:
    desk = Desk()
    desk.type(1, "1\rs")
    desk.clock.see(START_NS + 4_000_000_000, START_NS + 4_000_000_000)
    desk.marking.end()
    desk.marking.end()
    assert desk.written()[-1] == (4.0, "standing still at 1 from 1.000 to 4.000")


KEYS = st.lists(
    st.tuples(st.sampled_from(["1\r", "2\r", "n", "p", "s", "u", "wx\r"]), st.integers(0, 5000)),
    max_size=30,
)


@given(KEYS)
def test_a_log_says_what_the_operator_did(keys: list[tuple[str, int]]) -> None:
    """Whatever is typed, the log's marks are those that the operator has not undone."""
    desk = Desk()
    at_ms = 1
    for text, pause_ms in keys:
        at_ms += pause_ms
        desk.type(at_ms / 1e3, text)
    expected = [mark for mark, _ in desk.marking._progress.done]
    found = [mark for mark in read(desk.written()) if not mark.undone]
    assert found == expected


def test_a_clock_of_the_camera_is_read_over_the_fastest_frame() -> None:
    own = CaptureClock("server (X-Timestamp of each part)")
    assert own.capture_ns(5_000) == 5_000
    for arrival_ns, late_ns in ((10_000, 700), (20_000, 300), (30_000, 900)):
        # A clock that is 5000 ns behind ours.
        own.see(arrival_ns - late_ns - 5_000, arrival_ns)
    assert own.capture_ns(40_000) == 40_000 - 5_300
    kernel = live_clock.kernel_clock(time.monotonic_ns())
    assert kernel is not None
    for name in (live_clock.ARRIVAL, kernel.name, f"{live_clock.ARRIVAL}, after decoding"):
        system = CaptureClock(name)
        system.see(10_000, 10_700)
        assert system.capture_ns(40_000) == 40_000


class LiveFrames:
    """A live source of a few frames that says when each is taken."""

    name = "live"
    attachments: dict[str, bytes] = {}  # noqa: RUF012 - as a source has them
    image_size = (64, 48)

    def __init__(self, count: int, keys: dict[int, str] | None = None) -> None:
        self.count, self.keys = count, keys or {}
        self.notes = Notes()
        self.clock = CaptureClock("server")
        self.input = KeyInput(Marking(self.notes, self.clock))
        self.end = self.input._marking.end

    def describe(self) -> dict[str, str]:
        return {"clock": "server"}

    def frame_count(self) -> int | None:
        return None

    def preparation(self) -> str | None:
        return None

    def stop(self) -> None:
        """It ends by itself."""

    def frames(self) -> Iterator[CapturedFrame | SourceEvent]:
        for i in range(self.count):
            item = frame(i)
            yield item
            # frame() arrives 7 ns after its capture; keys come at the time of arrivals.
            list(self.input.feed(self.keys.get(i, ""), item.arrival_ns))


def test_a_recording_writes_marks_by_the_clock_of_its_frames(tmp_path: Path) -> None:
    live = LiveFrames(30, {5: "1\r", 6: "s", 16: "s", 20: "2\r", 21: "s"})
    source = WatchedSource(live, live.clock, live.end)
    record(source, tmp_path / "x.mcap", notes=live.notes)
    with LogReader(tmp_path / "x.mcap") as log:
        assert log_marks(log) == (
            Mark("1", 0.5, 0.5, stood=False),
            Mark("1", 0.6, 1.6, stood=True),
            Mark("2", 2.0, 2.0, stood=False),
            Mark("2", 2.1, 2.9, stood=True),
        )
        first = next(r for r in log.records() if isinstance(r, LogEvent))
        assert log.start_ns is not None
        assert first.timestamp_ns == log.start_ns + 500_000_000
    text = info_text(log_info(tmp_path / "x.mcap"))
    assert "arrived at 1, 2; stood at 1 (1.0 s), 2 (0.8 s)" in text


def test_marks_count_from_the_first_part_of_a_recording(tmp_path: Path) -> None:
    live = LiveFrames(30, {6: "1\r", 7: "s", 23: "s"})
    source = WatchedSource(live, live.clock, live.end)
    parts = record(
        source, tmp_path / "x.mcap", notes=live.notes, split=SplitLimit(seconds=1.0)
    ).parts
    assert len(parts) == 3
    stood = Mark("1", 0.7, 2.3, stood=True)
    assert log_marks(open_log(parts)) == (Mark("1", 0.6, 0.6, stood=False), stood)
    assert stood in [mark for part in parts for mark in log_marks(LogReader(part))]


TRUTH = Truth(
    "map",
    "",
    waypoints=(
        Waypoint("1", 1.0, 2.0, 0.5, math.pi / 2, 0.005),
        Waypoint("2", 3.0, 4.0, None, None, 0.01),
    ),
)


def arrival(name: str, at_s: float) -> Mark:
    return Mark(name, at_s, at_s, stood=False)


def test_marked_waypoints_are_timed_poses() -> None:
    marks = [arrival("2", 9.0), Mark("1", 1.5, 4.0, stood=True), arrival("2", 20.0)]
    timed = timed_marks(TRUTH, marks)
    assert timed.problems == ()
    assert ARRIVAL_S == 0.2
    assert timed.poses == (
        StoodPose(1.5, 4.0, 1.0, 2.0, 0.5, math.pi / 2, 0.005, "1"),
        StoodPose(8.9, 9.1, 3.0, 4.0, None, None, 0.01, "2"),
        StoodPose(19.9, 20.1, 3.0, 4.0, None, None, 0.01, "2"),
    )


@pytest.mark.parametrize(
    ("marks", "spans", "problem"),
    [
        ([arrival("1", 0.05)], [(0.0, 0.15)], None),
        # On arrival and then still: the span says it all.
        ([arrival("1", 2.0), Mark("1", 2.0, 5.0, True)], [(2.0, 5.0)], None),
        # Cut where the standing begins.
        ([arrival("1", 2.0), Mark("1", 2.05, 5.0, True)], [(1.9, 2.05), (2.05, 5.0)], None),
        ([Mark("1", 2.0, 5.0, True), arrival("2", 5.05)], [(2.0, 5.0), (5.0, 5.15)], None),
        ([arrival("1", 2.0), arrival("2", 2.15)], [(1.9, 2.1), (2.1, 2.25)], None),
        ([arrival("7", 1.0)], [], "waypoint 7 is marked, and not in the truth, which has 1, 2"),
        ([Mark("1", 2.0, None, True)], [], "not ended"),
        ([Mark("1", 2.0, 5.0, True), arrival("2", 3.0)], [(2.0, 5.0)], "elsewhere"),
        ([Mark("1", 2.0, 5.0, True), Mark("2", 4.0, 6.0, True)], [(2.0, 5.0)], "overlaps"),
        ([Mark("1", 2.0, 5.0, True, undone=True)], [], None),
    ],
)
def test_marks_that_meet_each_other(
    marks: list[Mark], spans: list[tuple[float, float]], problem: str | None
) -> None:
    timed = timed_marks(TRUTH, marks)
    assert [(pose.from_s, pose.to_s) for pose in timed.poses] == spans
    assert len(timed.problems) == (problem is not None)
    assert problem is None or problem in timed.problems[0]


MARKS = st.lists(
    st.builds(
        lambda name, from_ms, lasts_ms, undone: Mark(
            name, from_ms / 1e3, (from_ms + lasts_ms) / 1e3, lasts_ms > 0, undone
        ),
        st.sampled_from("12"),
        st.integers(0, 3000),
        st.integers(0, 800),
        st.booleans(),
    ),
    max_size=12,
)


@given(MARKS)
def test_timed_poses_never_overlap_and_take_nothing_from_the_file(marks: list[Mark]) -> None:
    own = StoodPose(1.0, 1.5, 0.0, 0.0, None, None, 0.01)
    truth, _ = with_marks(Truth("map", "", poses=(own,), waypoints=TRUTH.waypoints), marks)
    assert own in truth.poses
    for before, after in pairwise(truth.poses):
        assert before.from_s < before.to_s <= after.from_s < after.to_s


def test_waypoints_without_marks_are_told() -> None:
    truth, problems = with_marks(TRUTH, ())
    assert truth.poses == ()
    assert "no marks" in problems[0]


def marked_log(path: Path, truth: bytes | None) -> Path:
    """A camera that stands at x = 0.1 for 0.5 s, then is 0.4 s elsewhere, at 10 frames/s."""
    log = worlds.small_log(path.with_name("drawn.mcap"), 12, moving=False, exact=False)
    events = {
        2: "standing still at 1 from 0.200",
        7: "standing still at 1 from 0.200 to 0.700",
        9: "arrived at 2",
        10: "arrived at 3",
        11: "undone: arrived at 3 at 1.000",
    }
    with LogReader(log) as drawn:
        attachments = {n: d for n, d in drawn.attachments.items() if n != "truth.yaml"}
        if truth is not None:
            attachments["truth.yaml"] = truth
        with LogWriter(path, attachments=attachments, session={}) as writer:
            for image in drawn.records():
                assert not isinstance(image, LogEvent)
                i = image.frame_index
                stamp_ns = image.timestamp_ns
                writer.write_frame(
                    CapturedFrame(i, stamp_ns, stamp_ns, image.data, image.format)  # type: ignore[union-attr]
                )
                if i in events:
                    writer.write_event(stamp_ns, "info", events[i], name="operator")
    return path


WAYPOINTS = b"""\
floor: {square_m: 0.1, origin_m: [-0.3, 0.0], yaw_deg: 0, z_m: 0.3}
waypoints:
  - {name: 1, row: 1, col: 0, heading_deg: 17, std_m: 0.005}
  - {name: 2, x_m: 0.7, y_m: 0.2, std_m: 0.01}
"""


@pytest.mark.parametrize("later", [False, True])
def test_a_replay_has_measured_rows_where_waypoints_were_marked(
    tmp_path: Path, later: bool
) -> None:
    log = marked_log(tmp_path / "x.mcap", None if later else WAYPOINTS)
    (tmp_path / "truth.yaml").write_bytes(WAYPOINTS)
    overrides = Overrides(truth=tmp_path / "truth.yaml" if later else None)
    options = ReplayOptions(overrides=overrides, rrd=False, progress=False)
    summary = replay(log, tmp_path / "result", "r", options)
    truth = pd.read_parquet(tmp_path / "result" / "truth.parquet")
    assert set(truth.kind) == {"measured"}
    assert truth.frame_index.tolist() == [2, 3, 4, 5, 6, 7, 8, 9, 10]
    stood, arrived = truth[truth.frame_index <= 7], truth[truth.frame_index > 7]
    assert stood.x_m.tolist() == pytest.approx([-0.3] * 6)
    assert stood.y_m.tolist() == pytest.approx([0.1] * 6)
    assert stood.z_m.tolist() == [0.3] * 6
    assert stood.yaw_rad.tolist() == pytest.approx([math.radians(17)] * 6)
    assert set(stood.std_m) == {0.005}
    # An arrival is true a tenth of a second before and after.
    assert arrived.x_m.tolist() == [0.7] * 3
    assert arrived.yaw_rad.isna().all()
    assert set(arrived.std_m) == {0.01}
    assert summary["truth_problems"] == []
    assert not summary["truth_without_frames"]
    errors = summary["errors"]["measured"]["fixes"]
    assert errors["n"] == 9


def test_a_replay_names_marks_that_have_no_place(tmp_path: Path) -> None:
    truth = b"waypoints: [{name: 1, x_m: 0, y_m: 0, std_m: 0.1}]\n"
    options = ReplayOptions(rrd=False, progress=False)
    summary = replay(marked_log(tmp_path / "x.mcap", truth), tmp_path / "r", "r", options)
    assert summary["truth_problems"] == ["waypoint 2 is marked, and not in the truth, which has 1"]
