"""What is lost of a log, and how regular it is: logs and stamps of which that is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recorder.info import log_info
from recorder.record import record
from recorder.sources.base import CapturedFrame
from recorder.verify.pace import Pace, pace_of
from recorder.verify.run import verify
from recorder.verify.verdict import LogVerdict
from tests.log_helpers import attachments, frame, png
from tests.test_record import ScriptedSource
from tests.test_verify import assert_only, log_of, rule

STEP_NS = 100_000_000


def at(times_s: NDArray[np.float64], numbers: NDArray[np.int64] | None = None) -> Pace:
    """The pace of frames that were taken at these times."""
    stamps_ns = 1_700_000_000 * 10**9 + np.rint(np.asarray(times_s) * 1e9).astype(np.int64)
    indices = np.arange(len(stamps_ns)) if numbers is None else numbers
    found = pace_of(indices, stamps_ns, np.ones(len(stamps_ns) - 1, dtype=bool))
    assert found is not None
    return found


def log_at(path: Path, times_s: NDArray[np.float64]) -> Path:
    """Frames without a gap in their numbers, taken at these times."""

    def taken(i: int, item: CapturedFrame) -> CapturedFrame:
        stamp_ns = frame(0).timestamp_ns + round(float(times_s[i]) * 1e9)
        return replace(item, timestamp_ns=stamp_ns, arrival_ns=stamp_ns)

    return log_of(path, count=len(times_s), change=taken)


def with_pause(frames: int, lost: int, before: int = 60) -> NDArray[np.float64]:
    """10 frames/s, and a pause in which `lost` frames do not come."""
    ticks = np.arange(frames)
    return 0.1 * np.where(ticks < before, ticks, ticks + lost)


def lost_of(verdict: LogVerdict) -> object:
    return rule(verdict, "gaps").values["frames_lost"]


@pytest.mark.parametrize(
    ("lost", "level", "share"), [(1, "warning", "0.5"), (10, "warning", "5"), (11, "failed", "5.5")]
)
def test_frames_lost_by_number(tmp_path: Path, lost: int, level: str, share: str) -> None:
    """Of 200; all at once."""
    path = log_of(
        tmp_path / "log.mcap",
        count=200,
        change=lambda i, item: None if 60 <= i < 60 + lost else item,
    )
    seconds = f"{0.1 * lost:.3f}"
    noun = "frame" if lost == 1 else "frames"
    text = f"{lost} {noun} lost, {share} % (limit 5 %), {seconds} s: {lost} by number; "
    text += f"most, {lost} in {0.1 * (lost + 1):.3f} s, after frame 59 at 5.900 s"
    assert_only(path, "gaps", level, text)


@pytest.mark.parametrize(
    ("lost", "level", "share"),
    [
        (1, "warning", "0.524"),
        (10, "warning", "5"),
        (11, "failed", "5.47"),
        (380, "failed", "66.7"),
    ],
)
def test_frames_lost_in_a_pause(tmp_path: Path, lost: int, level: str, share: str) -> None:
    """An outage has no frame numbers. 190 frames are there."""
    path = log_at(tmp_path / "log.mcap", with_pause(190, lost))
    noun = "frame" if lost == 1 else "frames"
    text = f"{lost} {noun} lost, {share} % (limit 5 %), {0.1 * lost:.3f} s: {lost} in pauses; "
    text += f"most, {lost} in {0.1 * (lost + 1):.3f} s, after frame 59 at 5.900 s"
    assert_only(path, "gaps", level, text)


@pytest.mark.parametrize(("paused", "level"), [(5, "warning"), (6, "failed")])
def test_both_kinds_of_loss_add_up(tmp_path: Path, paused: int, level: str) -> None:
    """5 by number, and as many in a pause: just the limit of 200."""
    times_s = with_pause(195, paused)

    def taken(i: int, item: CapturedFrame) -> CapturedFrame | None:
        if 100 <= i < 105:
            return None
        stamp_ns = frame(0).timestamp_ns + round(float(times_s[i]) * 1e9)
        return replace(item, timestamp_ns=stamp_ns, arrival_ns=stamp_ns)

    path = log_of(tmp_path / "log.mcap", count=195, change=taken)
    verdict = verify([path])
    found = rule(verdict, "gaps")
    assert found.level == level == verdict.level
    assert f": 5 by number, {paused} in pauses; most, {max(paused, 5)} in " in found.text


def test_frames_lost_at_the_end_are_those_the_recorder_counted(tmp_path: Path) -> None:
    for said, level in ((2, "warning"), (3, "failed")):
        path = log_of(tmp_path / f"{said}.mcap", said={"frames_dropped": str(said)})
        assert rule(verify([path]), "gaps").level == level
        assert f": {said} counted by the recorder" in rule(verify([path]), "gaps").text


def test_a_recording_that_dropped_less_than_one_percent_is_a_warning(tmp_path: Path) -> None:
    frames = [replace(frame(i), data=png()) for i in range(300) if i not in (40, 41)]
    summary = record(ScriptedSource([*frames], attachments()), tmp_path / "log.mcap")
    assert summary.frames_dropped == 2
    assert_only(tmp_path / "log.mcap", "gaps", "warning", "2 frames lost, 0.667 % (limit 5 %)")


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.0, 0.3),
    st.floats(0.0, 0.08),
    st.booleans(),
)
def test_every_frame_that_is_lost_without_a_number_is_counted(
    seed: int, share: float, jitter: float, numbered: bool
) -> None:
    """Any of them, one by one or several together; each frame may be a little off its time."""
    rng = np.random.default_rng(seed)
    ticks = np.flatnonzero(rng.random(2000) >= share)
    # All that are lost have a number, or none has.
    numbers = ticks - np.cumsum(np.diff(ticks, prepend=-1) - 1) * (not numbered)
    stamps = (ticks + np.clip(jitter * rng.standard_normal(len(ticks)), -0.2, 0.2)) / 30
    found = at(stamps, numbers)
    expected = 0 if numbered else int(ticks[-1] - ticks[0]) + 1 - len(ticks)
    # In one long stretch in which hardly a frame is regular the rate is no better known than that.
    known = 0 if share <= 0.1 or jitter == 0 else 0.01 * len(ticks)
    assert abs(int(found.lost.sum()) - expected) <= known
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.02)


def test_a_pause_whose_frames_come_in_a_burst_lacks_none(tmp_path: Path) -> None:
    """As of a camera over a network, which stamps on arrival: what waited comes at once."""
    times_s = 0.1 * np.arange(1000.0)
    times_s[500:530] = times_s[530] - 0.001 * np.arange(30, 0, -1)
    path = log_at(tmp_path / "log.mcap", times_s)
    verdict = verify([path])
    assert lost_of(verdict) == 0
    assert rule(verdict, "gaps").level == "ok"
    found = rule(verdict, "rate")
    assert found.level == "warning"
    assert "a pause of 3.070 s after frame 499, its frames in a burst" in found.text


def stalled(
    frames: int, after: int, stall_s: float, apart_s: float = 0.0003
) -> NDArray[np.float64]:
    """30 frames/s by a network that stalls: those that waited come `apart_s` from each other."""
    times_s = np.arange(frames) / 30
    came_s = times_s.copy()
    came_s[after + 1] += stall_s
    for i in range(after + 2, frames):
        came_s[i] = max(times_s[i], came_s[i - 1] + apart_s)
    return came_s


@pytest.mark.parametrize("apart_s", [0.00001, 0.0003, 0.003, 0.01])
@pytest.mark.parametrize("after", [1, 30, 75, 84])
def test_a_burst_loses_nothing_even_if_most_frames_are_in_it(after: int, apart_s: float) -> None:
    """Half of the recording is a stall."""
    found = at(stalled(300, after, 5.0, apart_s))
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.01)
    assert found.lost.sum() == 0
    assert not found.lossy.any()


@pytest.mark.parametrize("apart_s", [0.01, 0.015, 0.02, 0.025])
def test_a_pause_is_made_up_for_slowly_too(apart_s: float) -> None:
    """Not with a camera that goes faster for a while."""
    found = at(stalled(3000, 60, 5.0, apart_s))
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.01)
    assert found.lost.sum() == 0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1.0, 5.0), st.integers(8, 100), st.integers(0, 20))
def test_what_is_lost_around_a_burst_is_what_is_missing(
    seed: int, stall_s: float, after: int, outage: int
) -> None:
    """In the burst and in an outage behind it; each frame may be a little off its time."""
    rng = np.random.default_rng(seed)
    came_s = stalled(300, after, stall_s)
    came_s[290:] += outage / 30
    gone = rng.choice(
        np.arange(after + 2, after + 25), size=int(rng.integers(0, 10)), replace=False
    )
    came_s = np.delete(came_s, gone)
    found = at(came_s + np.sort(rng.uniform(0, 0.0002, len(came_s))))
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.01)
    assert found.lost.sum() == outage + len(gone)


def test_a_stream_that_only_comes_in_bursts_loses_nothing() -> None:
    """Thirty frames at once, each second."""
    ticks = np.arange(900)
    found = at(ticks // 30 + 0.001 * (ticks % 30))
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.05)
    assert found.lost.sum() == 0


def queued(ready_s: NDArray[np.float64], apart_s: float) -> NDArray[np.float64]:
    """When they come: in order, none before it is ready, and `apart_s` from each other or more."""
    waits_s = apart_s * np.arange(len(ready_s))
    came_s: NDArray[np.float64] = np.maximum.accumulate(ready_s - waits_s) + waits_s
    return came_s


def taken_s(rng: np.random.Generator, frames: int, jitter: float) -> NDArray[np.float64]:
    """30 frames/s, each a little off its time, but by no more than a fifth of the interval."""
    off = np.clip(jitter * rng.standard_normal(frames), -0.2, 0.2)
    return (np.arange(frames) + off) / 30


def bursts(
    rng: np.random.Generator, frames: int, held: int, of: int, apart_s: float, jitter: float
) -> NDArray[np.float64]:
    """The first `held` of each `of` come when the last of them does; begun and ended anywhere."""
    frames = of * (-(-frames // of) + 1)
    ready_s = taken_s(rng, frames, jitter)
    place = np.arange(frames) % of
    ready_s = np.where(place < held, ready_s[np.arange(frames) - place + held - 1], ready_s)
    first, behind = rng.integers(of, size=2)
    return queued(ready_s, apart_s)[first : frames - behind]


@pytest.mark.parametrize("jitter", [0.0, 0.02, 0.1, 0.2])
@pytest.mark.parametrize("apart_s", [0.0001, 0.001, 0.003, 0.008, 0.01])
def test_bursts_lose_nothing_however_many_frames_are_in_them(apart_s: float, jitter: float) -> None:
    """All frames of each burst, all but one, most, some or only two; also with lost numbers."""
    rng = np.random.default_rng(6)
    for of in (2, 3, 4, 5, 8, 10, 15, 30, 60):
        for held in {2, of // 2, of // 2 + 1, 4 * of // 5, of - 2, of - 1, of} - {-1, 0, 1}:
            times_s = bursts(rng, int(rng.integers(12 * of + 200, 3000)), held, of, apart_s, jitter)
            lacking = rng.random(len(times_s)) < rng.choice([0, rng.uniform(0.01, 0.3)])
            found = at(times_s[~lacking], np.flatnonzero(~lacking))
            case = (held, of, len(times_s), int(lacking.sum()))
            assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.05), case
            # One may be late by half of an interval for its jitter alone.
            assert found.lost.sum() <= (1 if jitter else 0), case


@pytest.mark.parametrize(("held", "of", "apart_s"), [(28, 30, 1e-3), (15, 30, 1e-3), (9, 10, 1e-3)])
def test_a_log_that_mostly_comes_in_bursts_lacks_none(
    tmp_path: Path, held: int, of: int, apart_s: float
) -> None:
    path = log_at(
        tmp_path / "log.mcap", bursts(np.random.default_rng(0), 900, held, of, apart_s, 0)
    )
    verdict = verify([path], decode=False)
    assert rule(verdict, "gaps").level == "ok"
    # But its stamps are no times of capture.
    assert rule(verdict, "rate").level == "failed"
    assert rule(verdict, "rate").values["rate_hz"] == pytest.approx(30, rel=0.01)


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(0.05, 0.9),
    st.floats(3, 40),
    st.floats(0.0001, 0.01),
    st.floats(0.0, 0.1),
)
def test_bursts_of_any_length_lose_nothing(
    seed: int, share: float, mean: float, apart_s: float, jitter: float
) -> None:
    rng = np.random.default_rng(seed)
    ready_s = taken_s(rng, 3000, jitter)
    first = 0
    while first < len(ready_s):
        last = min(first + 1 + int(rng.exponential(mean)), len(ready_s) - 1)
        ready_s[first : last + 1] = ready_s[last]
        first = last + 1 + int(rng.exponential(mean * (1 - share) / share))
    found = at(queued(ready_s, apart_s))
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.05)
    # Where hardly a frame comes at its own time the rate is no better known than that.
    assert found.lost.sum() <= 0.01 * len(ready_s)


def test_long_bursts_of_most_frames_lose_nothing() -> None:
    """Frames at their own time are a hundred apart, and the interval is known by them alone."""
    rng = np.random.default_rng(204)
    ready_s = taken_s(rng, 3000, 0.0625)
    first = 0
    while first < len(ready_s):
        last = min(first + 1 + int(rng.exponential(31.5)), len(ready_s) - 1)
        ready_s[first : last + 1] = ready_s[last]
        first = last + 1 + int(rng.exponential(11.9))
    found = at(queued(ready_s, 1 / 256))
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.001)
    assert found.lost.sum() == 0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.floats(0.0, 0.1))
def test_a_few_outages_are_counted_however_long_they_are(
    seed: int, outages: int, jitter: float
) -> None:
    rng = np.random.default_rng(seed)
    steps = np.ones(1000)
    steps[rng.choice(np.arange(20, 980), outages, replace=False)] += rng.integers(1, 500, outages)
    off = np.clip(jitter * rng.standard_normal(1000), -0.2, 0.2)
    found = at((np.cumsum(steps) + off) / 30)
    assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.02)
    # As well as the rate is known.
    assert found.lost.sum() == pytest.approx(steps.sum() - 1000, rel=0.03, abs=1)


@pytest.mark.parametrize("share", [0.1, 0.25, 0.4])
def test_every_second_frame_of_a_stretch_is_as_of_a_camera_in_the_dark(share: float) -> None:
    rng = np.random.default_rng(2)
    for first in rng.integers(0, int(2000 * (1 - share)), 20):
        gone = np.arange(first, first + int(2000 * share), 2)
        found = at(np.delete(taken_s(rng, 2000, 0.05), gone))
        assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.05)
        assert found.lost.sum() <= 2


def test_few_frames_tell_their_rate_too() -> None:
    rng = np.random.default_rng(3)
    for frames in range(9, 41):
        found = at(taken_s(rng, frames, 0.05))
        assert found.usual_ns == pytest.approx(1e9 / 30, rel=0.05)
        assert found.lost.sum() == 0
    for frames in range(14, 41):
        gone = rng.choice(np.arange(4, frames - 4), frames // 10, replace=False)
        found = at(np.delete(taken_s(rng, frames, 0.02), gone))
        assert abs(int(found.lost.sum()) - len(gone)) <= 1


@pytest.mark.parametrize("before", [5, 60, 180])
def test_an_outage_is_not_taken_for_a_stall(before: int) -> None:
    """Two thirds are missing: the frames behind it come at the usual time."""
    found = at(with_pause(190, 380, before))
    assert found.usual_ns == pytest.approx(1e8)
    assert found.lost.sum() == 380


def test_a_stall_in_a_log_is_told_as_one(tmp_path: Path) -> None:
    path = log_at(tmp_path / "log.mcap", stalled(300, 74, 5.0))
    verdict = verify([path], decode=False)
    assert lost_of(verdict) == 0
    assert rule(verdict, "gaps").level == "ok"
    assert rule(verdict, "rate").text.startswith("30.00 frames/s, but ")
    assert [gap.after_frame for gap in log_info(path).images.gaps] == [74]


@pytest.mark.parametrize(("slower", "lost"), [(2, 0), (3, 600)])
def test_a_camera_may_halve_its_rate_in_the_dark(tmp_path: Path, slower: int, lost: int) -> None:
    """300 of 1000 intervals are longer; three times as long is more than an exposure does."""
    steps_s = np.full(1000, 0.1)
    steps_s[400:700] *= slower
    path = log_at(tmp_path / "log.mcap", np.concatenate([[0.0], np.cumsum(steps_s)]))
    verdict = verify([path], decode=False)
    assert lost_of(verdict) == lost
    if lost:
        assert (rule(verdict, "gaps").level, rule(verdict, "rate").level) == ("failed", "failed")
    else:
        found = rule(verdict, "rate")
        assert (found.level, verdict.count("failed")) == ("warning", 0)
        assert found.text == "10.00 frames/s, but 5.00 for 46.2 % of the time"


@pytest.mark.parametrize(
    ("every", "level", "percent"),
    [(200, "ok", "1.0"), (8, "warning", "25.0"), (7, "failed", "28.5")],
)
def test_intervals_that_are_off(tmp_path: Path, every: int, level: str, percent: str) -> None:
    """Each frame of several comes late, so that two intervals are off."""
    ticks = np.arange(401)
    times_s = 0.1 * ticks + 0.06 * (ticks % every == every // 2)
    path = log_at(tmp_path / "log.mcap", times_s)
    verdict = verify([path], decode=False)
    found = rule(verdict, "rate")
    assert found.level == level == verdict.level
    assert f"{percent} % of the intervals off by half of one or more" in found.text
    assert lost_of(verdict) == 0


def test_the_limit_is_what_stamps_have_that_say_nothing() -> None:
    """A frame anywhere within its own interval: the triangular distribution, outside of half."""
    rng = np.random.default_rng(4)
    found = at((np.arange(40_000) + rng.random(40_000)) / 30)
    assert found.off.mean() == pytest.approx(0.25, abs=0.01)
    # Frames at any time at all: exponential intervals, of which the mean is the usual one.
    found = at(np.cumsum(rng.exponential(1 / 30, 40_000)))
    assert found.off.mean() == pytest.approx(1 - np.exp(-0.5) + np.exp(-1.5), abs=0.02)


@pytest.mark.parametrize(("still", "level"), [(1, "warning"), (10, "warning"), (11, "failed")])
def test_stamps_that_stand_still(tmp_path: Path, still: int, level: str) -> None:
    """Of 40 intervals."""
    ticks = np.arange(41.0)
    ticks[10 : 11 + still] = 10
    found = rule(verify([log_at(tmp_path / "log.mcap", 0.1 * ticks)]), "stamps")
    noun = "frame" if still == 1 else "frames"
    text = f"{still} {noun} at the time of another, first 11: {still * 2.5:.3g} % (limit 25 %)"
    assert (found.level, found.text) == (level, text)


@pytest.mark.parametrize(
    ("kind", "rate", "said"),
    [
        ("v4l2", "20", "the camera was set to 20"),
        ("v4l2", "11", None),
        ("v4l2", "30000/1001", "the camera was set to 29.97"),
        ("v4l2", "0/0", None),
        ("rtsp", "25", None),
    ],
)
def test_a_camera_slower_than_it_was_set_to(
    tmp_path: Path, kind: str, rate: str, said: str | None
) -> None:
    """10 frames/s: as regular as any where every second frame of a camera is lost."""
    path = log_of(tmp_path / "log.mcap", source={"kind": kind, "rate_hz": rate})
    if said is None:
        assert rule(verify([path]), "rate").level == "ok"
    else:
        assert_only(path, "rate", "warning", said)


def test_few_frames_have_no_usual_rate(tmp_path: Path) -> None:
    verdict = verify([log_at(tmp_path / "log.mcap", np.array([0.0, 0.1, 0.2, 3.0, 9.0]))])
    assert rule(verdict, "rate").text == "too few frames to tell"
    assert lost_of(verdict) == 0
