"""Every rule on a log that keeps it, and on one that breaks it."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from recorder.capture.parts import SplitLimit
from recorder.cli import commands
from recorder.errors import InputError
from recorder.files.camera_file import camera_yaml
from recorder.files.map_file import map_yaml
from recorder.log import messages, topics
from recorder.log.mcap_output import McapOutput
from recorder.log.writer import LogWriter
from recorder.record import record
from recorder.sources.base import CapturedFrame
from recorder.verify.limits import CORRUPT_PERCENT, IRREGULAR_PERCENT, LOST_PERCENT
from recorder.verify.run import RULES, verify
from recorder.verify.verdict import LogVerdict, Verdict
from tests.log_helpers import TRUTH_YAML, attachments, camera, frame, marker_map, png
from tests.test_parts import split_log
from tests.test_record import ScriptedSource
from tests.test_recover import chunks_of

RULE_NAMES = [
    *("end", "parts", "checksums", "index", "counts", "gaps"),
    *("stamps", "rate", "arrivals", "images", "calibration", "map", "truth"),
]

Change = Callable[[int, CapturedFrame], CapturedFrame | None]


def same(index: int, item: CapturedFrame) -> CapturedFrame:
    return item


def log_of(
    path: Path,
    *,
    count: int = 40,
    change: Change = same,
    files: dict[str, bytes] | None = None,
    live: bool = False,
    said: dict[str, str] | None = None,
    ended: str = "complete",
    source: dict[str, str] | None = None,
) -> Path:
    """Images that can be decoded, at 10 frames/s."""
    given = attachments() if files is None else files
    session = {f"source.{key}": value for key, value in (source or {}).items()}
    session |= {"live": "yes"} if live else {}
    with LogWriter(path, attachments=given, session=session, live=live) as writer:
        for i in range(count):
            item = change(i, replace(frame(i), data=png()))
            if item is not None:
                writer.write_frame(item)
        writer.end_as(ended, **(said or {}))
    return path


def rule(verdict: LogVerdict, name: str) -> Verdict:
    return next(found for found in verdict.rules if found.rule == name)


def assert_only(path: Path | Iterable[Path], name: str, level: str, text: str) -> None:
    """One rule speaks up, and all others are content."""
    verdict = verify([path] if isinstance(path, Path) else list(path))
    found = rule(verdict, name)
    assert (found.level, verdict.level) == (level, level)
    assert text in found.text
    assert "\n" not in found.text
    assert [v for v in verdict.rules if v.level != "ok" and v.rule != name] == []


def test_a_good_log_keeps_every_rule(tmp_path: Path) -> None:
    verdict = verify([log_of(tmp_path / "log.mcap")])
    assert [found.rule for found in verdict.rules] == RULE_NAMES
    assert len(RULES) == len(RULE_NAMES)
    assert {found.level for found in verdict.rules} == {"ok"}
    assert all(found.text for found in verdict.rules)
    live = verify([log_of(tmp_path / "live.mcap", live=True)])
    assert {found.level for found in live.rules} == {"ok"}
    assert "0.0 ms after capture" in rule(live, "arrivals").text


def test_a_cut_log(tmp_path: Path) -> None:
    path = log_of(tmp_path / "log.mcap")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    verdict = verify([path])
    assert rule(verdict, "end").level == "failed"
    assert "cut short after" in rule(verdict, "end").text
    assert rule(verdict, "index").level == "failed"


@pytest.mark.parametrize(
    ("ended", "text"),
    [
        ("disk_full", "the disk was full"),
        ("disk_low", "the disk was nearly full"),
        ("error: no light", "no light"),
        ("recovered: cut short after 3 frames: x", "cut short after 3 frames"),
    ],
)
def test_how_it_ended(tmp_path: Path, ended: str, text: str) -> None:
    path = log_of(tmp_path / "log.mcap", ended=ended)
    assert_only(path, "end", "warning", text)


@pytest.mark.parametrize("back", [False, True])
def test_a_camera_that_was_lost_at_the_end(tmp_path: Path, back: bool) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path, attachments=attachments(), session={"live": "yes"}, live=True) as writer:
        for i in range(41 if back else 40):
            if i == 40:
                stamp_ns = frame(39).timestamp_ns
                writer.write_event(stamp_ns, "warning", "connected again after 0.1 s")
            writer.write_frame(replace(frame(i), data=png()))
            if i == 39:
                stamp_ns = frame(i).timestamp_ns
                writer.write_event(stamp_ns, "error", "connection lost after frame 39: refused")
                writer.write_event(stamp_ns, "error", "no connection: refused")
                writer.write_event(stamp_ns, "error", "of somebody else", name="operator")
        writer.end_as("interrupted", connection_lost_s="41.2")
    if back:
        assert verify([path]).level == "ok"
    else:
        text = "interrupted, but no frame came any more after: connection lost after frame 39: "
        text += "refused (in all 41.2 s without a connection)"
        assert_only(path, "end", "warning", text)


def test_an_interrupted_log_is_whole(tmp_path: Path) -> None:
    assert verify([log_of(tmp_path / "log.mcap", ended="interrupted")]).level == "ok"


def four_parts(folder: Path) -> list[Path]:
    """Of 30 frames each, without frames 10 and 11; the last one has 15."""
    paths, _ = split_log(folder, "3s", 105)
    return paths


def test_all_parts(tmp_path: Path) -> None:
    verdict = verify(four_parts(tmp_path), decode=False)
    assert {v.rule: v.level for v in verdict.rules if v.level != "ok"} == {"gaps": "warning"}
    assert rule(verdict, "parts").text == "all 4 parts"
    assert rule(verdict, "gaps").values["frames_lost"] == 2


def test_truth_of_parts_that_are_not_here_is_no_fault(tmp_path: Path) -> None:
    """Each part has the truth of the whole recording, here also of its third second."""
    paths, _ = split_log(tmp_path)
    for some in (paths[:1], paths[:2], paths[1:2], paths):
        assert rule(verify(some, decode=False), "truth").level == "ok"


@pytest.mark.parametrize(
    ("given", "gone", "frames", "seconds", "text"),
    [
        ((0, 3), [2, 3], 60, 6.1, "without parts 2, 3: 60 frames in 6.100 s"),
        ((0, 2, 3), [2], 30, 3.1, "without part 2: 30 frames in 3.100 s"),
        ((2, 3), [1, 2], 60, 6.0, "without parts 1, 2: 60 frames in 6.000 s"),
        ((0, 1), [], 0, 0.0, "the recording goes on in drive-003.mcap, which is not here"),
        (
            (1,),
            [1],
            30,
            3.0,
            "without part 1: 30 frames in 3.000 s; "
            "the recording goes on in drive-003.mcap, which is not here",
        ),
    ],
)
def test_parts_that_are_missing(
    tmp_path: Path, given: tuple[int, ...], gone: list[int], frames: int, seconds: float, text: str
) -> None:
    paths = four_parts(tmp_path)
    verdict = verify([paths[k] for k in given], decode=False)
    found = rule(verdict, "parts")
    # Each part is complete in itself: only a hole between parts makes them one log no more.
    hole = any(number > given[0] + 1 for number in gone)
    assert (found.level, found.text) == ("failed" if hole else "warning", text)
    assert found.values["missing_parts"] == gone
    assert found.values["frames_missing"] == frames
    assert found.values["seconds_missing"] == pytest.approx(seconds)
    # What is in the missing parts is told once, and no fault of those that are here.
    assert [v.rule for v in verdict.rules if v.level == "failed"] == ["parts"] * hole
    assert rule(verdict, "gaps").values["frames_lost"] == (2 if 0 in given else 0)
    assert rule(verdict, "rate").level == "ok"


def test_a_stamp_that_jumps_back_between_two_parts(tmp_path: Path) -> None:
    frames = [frame(i) for i in range(25)]
    later = [replace(f, timestamp_ns=f.timestamp_ns - 10**9) for f in frames[10:]]
    source = ScriptedSource([*frames[:10], *later])
    parts = record(source, tmp_path / "drive.mcap", split=SplitLimit(seconds=1)).parts
    assert rule(verify(parts, decode=False), "counts").level == "ok"
    assert rule(verify(parts, decode=False), "stamps").level == "failed"
    assert rule(verify(parts[1:2], decode=False), "counts").level == "ok"
    assert rule(verify(parts[1:2], decode=False), "stamps").level == "ok"


def test_a_flipped_bit_is_named_with_its_place(tmp_path: Path) -> None:
    path = log_of(tmp_path / "log.mcap")
    data = bytearray(path.read_bytes())
    at, size = chunks_of(bytes(data))[3]
    data[at + size // 2] ^= 4
    path.write_bytes(data)
    found = rule(verify([path]), "checksums")
    assert found.level == "failed"
    expected = f"a chunk's checksum is wrong after 15 frames (byte {at}, {size} bytes left out)"
    assert expected in found.text


def test_no_flipped_bit_is_ok(tmp_path: Path) -> None:
    """Wherever it is: also between the chunks, in their indices and in the session."""
    path = log_of(tmp_path / "log.mcap", count=31)
    data = path.read_bytes()
    found = rule(verify([path], decode=False), "checksums")
    assert found.level == "ok"
    positions = set(np.random.default_rng(6).integers(8, len(data), 40).tolist())
    at = 8
    while (opcode := data[at]) != 0x0F:
        (length,) = struct.unpack_from("<Q", data, at + 1)
        if opcode in (0x07, 0x0C):
            positions.add(at + 9 + length // 2)
            positions.add(at + 9 + length - 1)
        at += 9 + length
    for place in sorted(positions):
        broken = bytearray(data)
        broken[place] ^= 4
        path.write_bytes(broken)
        with suppress(InputError):
            assert verify([path], decode=False).level == "failed", place
    # Logs without this checksum, of other writers and of before, are as good as they were.
    older = bytearray(data)
    older[at + 9 : at + 13] = bytes(4)
    path.write_bytes(older)
    assert verify([path], decode=False).count("failed") == 0


def test_an_index_that_names_other_chunks(tmp_path: Path) -> None:
    path = log_of(tmp_path / "log.mcap")
    data = path.read_bytes()
    (summary_at,) = struct.unpack_from("<Q", data, len(data) - 28)
    at, size = chunks_of(data)[2]
    where = data.index(struct.pack("<QQ", at, size), summary_at)
    broken = bytearray(data)
    broken[where] ^= 1
    # The index has a checksum of its own: 0 says that there is none.
    broken[-12:-8] = bytes(4)
    path.write_bytes(broken)
    assert_only(path, "index", "failed", f"the chunk at byte {at} is not in it")


def test_statistics_that_count_other_images(tmp_path: Path) -> None:
    path = log_of(tmp_path / "log.mcap")
    data = path.read_bytes()
    at, _ = chunks_of(data)[3]
    # A chunk that is taken out whole, with what belongs to it up to the next one.
    behind, _ = chunks_of(data)[4]
    path.write_bytes(data[:at] + data[behind:])
    verdict = verify([path])
    assert rule(verdict, "index").level == "failed"
    assert rule(verdict, "counts").level == "failed"
    assert "the log says 40, 35 are there" in rule(verdict, "counts").text


@pytest.mark.parametrize(
    ("said", "text"),
    [
        ({"frames_written": "41"}, "frames_written: the log says 41, 40 are there"),
        ({"frames_corrupt": "1"}, "frames_corrupt: the log says 1, 0 are there"),
        ({"frames_stamped_back": "2"}, "frames_stamped_back: the log says 2, 0 are there"),
        ({"events": "1"}, "events: the log says 1, 0 are there"),
    ],
)
def test_counts_that_are_not_what_is_there(tmp_path: Path, said: dict[str, str], text: str) -> None:
    assert_only(log_of(tmp_path / "log.mcap", said=said), "counts", "failed", text)


@pytest.mark.parametrize(
    ("said", "inspected", "level"),
    [(0, 0, "ok"), (1, 0, "failed"), (1, 30, "ok"), (2, 30, "ok"), (3, 30, "failed")],
)
def test_corrupt_images_that_the_recorder_looked_into(
    tmp_path: Path, said: int, inspected: int, level: str
) -> None:
    """Into some of them: it may have found any of those that are there."""
    path = log_of(
        tmp_path / "log.mcap",
        count=200,
        change=lambda i, item: undecodable(item) if i in (3, 9) else item,
        said={"frames_corrupt": str(said), "frames_inspected": str(inspected)},
    )
    assert rule(verify([path]), "counts").level == level
    assert rule(verify([path], decode=False), "counts").level in (level, "ok")


def test_drops_that_were_not_counted(tmp_path: Path) -> None:
    path = log_of(
        tmp_path / "log.mcap",
        change=lambda i, item: None if i in (7, 8) else item,
        said={"frames_dropped": "1"},
    )
    found = rule(verify([path]), "counts")
    assert found.level == "failed"
    assert found.text == "frames_dropped: the log says 1, 2 numbers are missing"


def test_frame_numbers_that_do_not_increase(tmp_path: Path) -> None:
    """Our writer refuses them: this log is of another make."""
    path = tmp_path / "log.mcap"
    with path.open("xb", buffering=0) as raw:
        output = McapOutput(raw, tmp_path)
        output.add_metadata("session", {})
        for k, i in enumerate((0, 1, 1, 2)):
            image = messages.to_image(k * 10**8, png(), "png")
            output.write(topics.IMAGE, image, k * 10**8, k * 10**8, i)
        output.finish("session_end", {"ended": "complete"})
        output.close()
    found = rule(verify([path]), "gaps")
    assert (found.level, found.text) == ("failed", "frame numbers do not increase after frame 1")


def test_stamps_that_jump_back(tmp_path: Path) -> None:
    def change(i: int, item: CapturedFrame) -> CapturedFrame:
        return replace(item, timestamp_ns=item.timestamp_ns - 250_000_000 * (i == 30))

    path = log_of(tmp_path / "log.mcap", change=change)
    found = rule(verify([path]), "stamps")
    assert found.level == "failed"
    assert found.text == "they jump back once, first at frame 30 by 0.150000 s"
    assert rule(verify([path]), "counts").level == "ok"


def test_a_live_log_of_two_clocks(tmp_path: Path) -> None:
    def shift(i: int, item: CapturedFrame) -> CapturedFrame:
        return replace(item, arrival_ns=item.arrival_ns + 3_000_000_000)

    path = log_of(tmp_path / "log.mcap", change=shift, live=True)
    assert_only(path, "arrivals", "warning", "3.000 s apart: of two clocks?")


def test_frames_that_are_stamped_after_their_arrival(tmp_path: Path) -> None:
    def shift(i: int, item: CapturedFrame) -> CapturedFrame:
        return replace(item, arrival_ns=item.timestamp_ns - 177_000_000)

    path = log_of(tmp_path / "log.mcap", change=shift, live=True)
    assert_only(path, "arrivals", "warning", "captures are stamped 177.0 ms after they arrived")


def test_late_frames(tmp_path: Path) -> None:
    def late(i: int, item: CapturedFrame) -> CapturedFrame:
        return replace(item, arrival_ns=item.arrival_ns + 150_000_000 * (i == 30))

    path = log_of(tmp_path / "log.mcap", change=late, live=True)
    assert_only(path, "arrivals", "warning", "1 frame late")


def undecodable(item: CapturedFrame) -> CapturedFrame:
    """With a good header and a good end."""
    return replace(item, data=png(payload=b"no pixels"))


def test_images_that_cannot_be_decoded(tmp_path: Path) -> None:
    for bad, level in ((2, "warning"), (3, "failed")):
        path = log_of(
            tmp_path / f"{bad}.mcap",
            count=200,
            change=lambda i, f, bad=bad: undecodable(f) if i in range(9, 9 + bad) else f,  # type: ignore[misc]
        )
        text = f"{bad} frames corrupt, {bad / 2:g} % (limit 1 %), first 9: no png image that"
        assert_only(path, "images", level, text)
        assert rule(verify([path]), "images").values["percent_corrupt"] == bad / 2
        assert rule(verify([path], decode=False), "images").level == "ok"


def test_a_jpeg_that_is_damaged_inside(tmp_path: Path) -> None:
    """OpenCV decodes it without a word."""
    rng = np.random.default_rng(5)
    pixels = cv2.GaussianBlur(rng.integers(0, 256, (480, 640), np.uint8), (3, 3), 0)
    whole = cv2.imencode(".jpg", pixels)[1].tobytes()
    middle = len(whole) // 2
    broken = whole[:middle] + rng.bytes(500) + whole[middle + 500 :]

    def change(i: int, item: CapturedFrame) -> CapturedFrame:
        return replace(item, data=broken if i == 6 else whole, format="jpeg")

    path = log_of(tmp_path / "log.mcap", change=change, files={})
    found = rule(verify([path]), "images")
    assert found.text == "1 frame corrupt, 2.5 % (limit 1 %), first 6: a damaged jpeg image"
    assert rule(verify([path], decode=False), "images").level == "ok"


def test_images_that_are_cut_or_empty(tmp_path: Path) -> None:
    def cut(i: int, item: CapturedFrame) -> CapturedFrame:
        whole = cv2.imencode(".jpg", np.zeros((48, 64), np.uint8))[1].tobytes()
        item = replace(item, data=whole, format="jpeg")
        return replace(item, data=whole[:-30] if i == 3 else b"" if i == 4 else whole)

    path = log_of(tmp_path / "log.mcap", change=cut)
    found = rule(verify([path]), "images")
    assert found.level == "failed"
    assert found.text == (
        "2 frames corrupt, 5 % (limit 1 %), first 3: a jpeg image without its end and other faults"
    )
    # The recorder saw and counted them.
    assert rule(verify([path]), "counts").level == "ok"


@pytest.mark.parametrize(
    ("count", "level", "text"),
    [
        (
            100,
            "warning",
            "1 frame of another size, 1 % (limit 1 %), expected one size, found 99 of",
        ),
        (99, "failed", "1 frame of another size, 1.01 % (limit 1 %), expected one size, found 98"),
    ],
)
def test_images_of_several_sizes(tmp_path: Path, count: int, level: str, text: str) -> None:
    path = log_of(
        tmp_path / "log.mcap",
        count=count,
        change=lambda i, item: replace(item, data=png(32, 48)) if i == 5 else item,
        live=True,
        files={},
    )
    found = rule(verify([path]), "images")
    assert found.level == level
    assert found.text.startswith(text)
    # The recording's calibration is for what most of them are.
    with_camera = {"camera.yaml": camera_yaml(camera())}
    path = log_of(
        tmp_path / "camera.mcap",
        count=count,
        change=lambda i, item: replace(item, data=png(32, 48)) if i == 5 else item,
        live=True,
        files=with_camera,
    )
    assert rule(verify([path]), "calibration").level == "ok"


def test_quick_takes_the_recorders_word_for_what_it_does_not_look_at(tmp_path: Path) -> None:
    for said, level in (("0", "ok"), ("1", "failed")):
        path = log_of(tmp_path / f"{said}.mcap", said={"frames_corrupt": said}, live=True)
        found = rule(verify([path], decode=False), "images")
        assert found.level == level
    assert found.text == "1 frame corrupt by the recorder's count, 2.5 % (limit 1 %)"


def test_no_images(tmp_path: Path) -> None:
    path = log_of(tmp_path / "log.mcap", count=0)
    assert_only(path, "images", "failed", "there are none")


def with_files(path: Path, **files: bytes | None) -> Path:
    """A log with other files than usual, whatever a recorder would say to them."""
    given = attachments() | {f"{name}.yaml": data for name, data in files.items()}
    with path.open("xb", buffering=0) as raw:
        output = McapOutput(raw, path.parent)
        for name, data in given.items():
            if data is not None:
                output.add_attachment(0, name, "application/yaml", data)
        output.add_metadata("session", {})
        for i in range(40):
            stamp = frame(i).timestamp_ns
            image = messages.to_image(stamp, png(), "png")
            output.write(topics.IMAGE, image, stamp, stamp, i)
        output.finish("session_end", {"ended": "complete", "frames_written": "40"})
        output.close()
    return path


@pytest.mark.parametrize(
    ("data", "level", "text"),
    [
        (None, "warning", "there is none: replay needs --camera"),
        (b"camera_name: x\n", "failed", "expected"),
        (camera_yaml(camera(48, 64)), "failed", "it is for 48x64, the images are 64x48"),
        (
            camera_yaml(camera()).replace(b"31.5", b"131.5"),
            "warning",
            "its principal point 131.5, 23.5 is outside of the image",
        ),
    ],
)
def test_calibration(tmp_path: Path, data: bytes | None, level: str, text: str) -> None:
    assert_only(with_files(tmp_path / "log.mcap", camera=data), "calibration", level, text)


def test_map(tmp_path: Path) -> None:
    missing = with_files(tmp_path / "a.mcap", map=None, truth=None)
    assert_only(missing, "map", "warning", "there is none: replay needs --map")
    twice = map_yaml(marker_map()).replace(b"id: 1", b"id: 0")
    found = rule(verify([with_files(tmp_path / "b.mcap", map=twice)]), "map")
    assert found.level == "failed"
    assert "0" in found.text
    markers = marker_map().markers
    close = replace(marker_map(), markers=(*markers, replace(markers[0], id=9)))
    found = rule(verify([with_files(tmp_path / "c.mcap", map=map_yaml(close))]), "map")
    assert found.level == "failed"


@pytest.mark.parametrize(
    ("data", "level", "text"),
    [
        (b"frame: map\npoint: 3\n", "failed", "expected"),
        (TRUTH_YAML.replace(b"frame: map", b"frame: hall"), "failed", "frame: expected the map's"),
        (
            TRUTH_YAML.replace(b"from_s: 2, to_s: 3", b"from_s: 20, to_s: 30"),
            "failed",
            "the pose from 20 s to 30 s is after the log, which ends at 3.900 s",
        ),
        (TRUTH_YAML.replace(b"[3, 2]", b"[3000, 2]"), "failed", "outside of the markers' extent"),
        (
            TRUTH_YAML + b"waypoints:\n  - {name: far, x_m: 300, y_m: 1, std_m: 0.01}\n",
            "failed",
            "waypoint far is 298.50 m outside of the markers' extent",
        ),
    ],
)
def test_truth(tmp_path: Path, data: bytes, level: str, text: str) -> None:
    verdict = verify([with_files(tmp_path / "log.mcap", truth=data)])
    found = rule(verdict, "truth")
    assert found.level == level
    assert text in found.text


def run(*arguments: str | Path) -> Result:
    command = {c.name: c for c in commands()}["verify"]
    return CliRunner().invoke(command, [str(a) for a in arguments])


def test_the_command_and_its_exit_code(tmp_path: Path) -> None:
    good = log_of(tmp_path / "good.mcap")
    bad = log_of(tmp_path / "bad.mcap", said={"frames_written": "41"})
    gap = log_of(tmp_path / "gap.mcap", change=lambda i, f: None if i == 7 else f)
    full_of_gaps = log_of(tmp_path / "full.mcap", change=lambda i, f: None if i % 3 else f)
    done = run(good)
    assert done.exit_code == 0
    assert done.output.splitlines()[0] == f"{good}: ok"
    done = run(gap)
    assert done.exit_code == 0
    assert done.output.splitlines()[0] == f"{gap}: ok (1 warning)"
    done = run(full_of_gaps)
    assert done.exit_code == 1
    assert done.output.splitlines()[0] == f"{full_of_gaps}: failed (1 of 13 rules failed)"
    assert "26 frames lost, 65 % (limit 5 %), 2.600 s: 26 by number" in done.output
    done = run(good, bad)
    assert done.exit_code == 1
    assert f"{bad}: failed (1 of 13 rules failed)" in done.output
    done = run(good, bad, gap, "--json", "--quick")
    assert done.exit_code == 1
    told = json.loads(done.output)
    assert [log["verdict"] for log in told] == ["ok", "failed", "warning"]
    assert [r["rule"] for r in told[1]["rules"]] == RULE_NAMES
    (gaps,) = (r["values"] for r in told[2]["rules"] if r["rule"] == "gaps")
    assert (gaps["frames_lost"], gaps["percent_lost"]) == (1, 2.5)
    assert gaps["seconds_lost"] == pytest.approx(0.1)


def test_the_help_says_what_fails() -> None:
    text = run("--help").output
    assert all(re.search(rf"\b{name}\b", text) for name in RULE_NAMES if name != "arrivals")
    for limit in (LOST_PERCENT, CORRUPT_PERCENT, IRREGULAR_PERCENT):
        assert f"more than {limit:g} %" in text


def test_the_command_takes_parts_together(tmp_path: Path) -> None:
    paths = four_parts(tmp_path)
    done = run(*paths, "--quick")
    assert done.exit_code == 0
    assert done.output.startswith(f"{paths[0]} to drive-004.mcap: ok (1 warning)")
    assert run(*paths[:2], "--quick").exit_code == 0
    assert run(*paths[::2], "--quick").exit_code == 1


def test_a_live_log_of_another_camera_fails_by_its_calibration_alone(tmp_path: Path) -> None:
    files = {**attachments(), "camera.yaml": camera_yaml(camera(80, 60))}
    path = log_of(tmp_path / "log.mcap", files=files, live=True)
    failed = [v for v in verify([path]).rules if v.level == "failed"]
    assert [v.rule for v in failed] == ["calibration"]
