"""`arucolog truth`: floor coordinates worked out by hand, slips that are found, timed files."""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from pipeline.markers import Marker, MarkerMap
from recorder.bench.check.run import TruthCheck, check_truth
from recorder.bench.check.time_rules import LogTimes
from recorder.bench.floor import Floor
from recorder.bench.marks import Mark
from recorder.errors import InputError
from recorder.files.map_file import map_yaml
from recorder.files.truth_entries import TruthFile, truth_yaml
from recorder.files.truth_file import parse_truth
from recorder.files.yaml_file import parse_yaml
from recorder.log.writer import LogWriter
from recorder.truth_cli import truth_group
from tests import worlds
from tests.log_helpers import attachments, frame

PATH = Path("truth.yaml")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(truth_group, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("floor", "row", "col", "place"),
    [
        (Floor(0.25), 0, 0, (0.0, 0.0)),
        (Floor(0.25), 4, 6, (1.5, 1.0)),
        (Floor(0.25), -2, 0.5, (0.125, -0.5)),
        (Floor(0.25, (10.0, 20.0)), 4, 6, (11.5, 21.0)),
        # Columns along map y: rows then go along -x.
        (Floor(0.25, (10.0, 20.0), math.pi / 2), 4, 6, (9.0, 21.5)),
        (Floor(0.25, (0.0, 0.0), math.pi), 4, 6, (-1.5, -1.0)),
        # 2 (cos 30, sin 30) + 1 (-sin 30, cos 30)
        (Floor(1.0, (0.0, 0.0), math.pi / 6), 1, 2, (math.sqrt(3) - 0.5, 1 + math.sqrt(3) / 2)),
    ],
)
def test_places_on_a_floor_by_hand(
    floor: Floor, row: float, col: float, place: tuple[float, float]
) -> None:
    assert floor.place(row, col) == pytest.approx(place, abs=1e-12)


def test_a_truth_file_takes_rows_and_columns() -> None:
    truth = parse_truth(
        b"floor: {square_m: 0.5, origin_m: [1, 2], yaw_deg: 90, z_m: 1.3}\n"
        b"waypoints:\n"
        b"  - {name: 3, row: 4, col: 7, heading_deg: 90, std_m: 0.005}\n"
        b"  - {name: door, row: 0, col: 1, z_m: 0.2, std_m: 0.005}\n"
        b"  - {name: 5, x_m: 9, y_m: 8, yaw_deg: -90, std_m: 0.01}\n",
        PATH,
    )
    three, door, five = truth.waypoints
    assert (three.name, three.x_m, three.y_m, three.z_m) == ("3", 1 - 2.0, 2 + 3.5, 1.3)
    assert three.yaw_rad == pytest.approx(math.pi)
    assert (door.x_m, door.y_m, door.z_m, door.yaw_rad) == (1.0, 2.5, 0.2, None)
    # What is given in metres has nothing of the floor.
    assert (five.x_m, five.y_m, five.z_m, five.yaw_rad) == (9.0, 8.0, None, -math.pi / 2)


W = "std_m: 0.01}"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (f"waypoints: [{{name: 1, x_m: 0, {W}]", ["waypoints[0]", "x_m, y_m", "found x_m"]),
        (f"waypoints: [{{name: 1, {W}]", ["waypoints[0]", "found none of them"]),
        (
            f"waypoints: [{{name: 1, x_m: 0, y_m: 0, row: 1, col: 1, {W}]",
            ["found x_m, y_m, row, col"],
        ),
        (
            f"waypoints: [{{name: 1, x_m: 0, y_m: 0, heading_deg: 1, {W}]",
            ["found x_m, y_m, heading_deg"],
        ),
        (f"waypoints: [{{name: 1, row: 1, col: 1, {W}]", ["waypoints[0]", "floor"]),
        (f"waypoints: [{{name: a b, x_m: 0, y_m: 0, {W}]", ["waypoints[0].name", "'a b'"]),
        (f"waypoints: [{{name: 1.5, x_m: 0, y_m: 0, {W}]", ["waypoints[0].name", "1.5"]),
        (f"waypoints: [{{name: true, x_m: 0, y_m: 0, {W}]", ["waypoints[0].name", "True"]),
        (
            f"waypoints: [{{name: a, x_m: 0, y_m: 0, {W}, {{name: A, x_m: 1, y_m: 0, {W}]",
            ["waypoints[1].name", "once", "waypoints[0]"],
        ),
        ("waypoints: [{name: 1, x_m: 0, y_m: 0}]", ["waypoints[0].std_m"]),
        ("waypoints: [{name: 1, x_m: 0, y_m: 0, std_m: 0}]", ["waypoints[0].std_m"]),
        ("floor: {square_m: 0}", ["floor.square_m"]),
        ("floor: {square_m: 1}", ["path, poses or both, or waypoints"]),
        ("poses: [{from_s: -1, to_s: 1, x_m: 0, y_m: 0, std_m: 1}]", ["poses[0].from_s", "-1"]),
    ],
)
def test_mistakes_are_named(data: str, words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        parse_truth(data.encode(), PATH)
    assert all(word in str(error.value) for word in words), str(error.value)


numbers = st.floats(-1e3, 1e3).map(lambda x: round(x, 6))
names = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,9}", fullmatch=True)


@given(
    st.lists(st.tuples(names, numbers, numbers, st.none() | numbers), min_size=1, max_size=5,
             unique_by=lambda w: w[0].casefold()),
    st.floats(0.01, 2.0),
    st.text(max_size=20),
)  # fmt: skip
def test_what_is_written_is_read_back(
    points: list[tuple[str, float, float, float | None]], side: float, method: str
) -> None:
    file = TruthFile.model_validate(
        {
            "method": method,
            "floor": {"square_m": side},
            "waypoints": [
                {"name": n, "row": r, "col": c, "heading_deg": h, "std_m": 0.005}
                for n, r, c, h in points
            ],
        }
    )
    assert TruthFile.model_validate(parse_yaml(truth_yaml(file), PATH)) == file


def test_floor_writes_what_was_counted(tmp_path: Path) -> None:
    out = tmp_path / "truth.yaml"
    done = run(
        "floor", "--square-m", "1/6", "--origin-m", "0.5,-1", "--z-m", "1.334",
        "0,0,0", "0,18,90", "a=-6,3", "--path", "0,0 0,18 12,18 12,0", "--closed", "-o", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    truth = parse_truth(out.read_bytes(), out)
    assert truth.path is not None
    assert truth.path.points_m.tolist() == [[0.5, -1], [3.5, -1], [3.5, 1], [0.5, 1]]
    assert truth.path.closed
    one, two, a = truth.waypoints
    assert [w.name for w in truth.waypoints] == ["1", "2", "a"]
    assert (one.x_m, one.y_m, one.z_m, one.yaw_rad) == (0.5, -1.0, 1.334, 0.0)
    assert (two.x_m, two.y_m) == pytest.approx((3.5, -1.0), abs=1e-12)
    assert two.yaw_rad == pytest.approx(math.pi / 2)
    assert (a.x_m, a.y_m, a.yaw_rad) == pytest.approx((1.0, -2.0, None), abs=1e-12)
    # An existing file stays.
    assert run("floor", "--square-m", "1", "0,0", "-o", out).exit_code == 1
    assert parse_truth(out.read_bytes(), out).waypoints == truth.waypoints


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--square-m", "0", "0,0"], "1/6"),
        (["--square-m", "1/0", "0,0"], "1/6"),
        (["--square-m", "nan", "0,0"], "1/6"),
        (["--square-m", "1", "0"], "ROW,COL"),
        (["--square-m", "1", "0,inf"], "ROW,COL"),
        (["--square-m", "1", "1,2", "1=3,4"], "each name once"),
        (["--square-m", "1"], "found neither"),
        (["--square-m", "1", "--path", "0,0"], "two points"),
        (["--square-m", "1", "0,0", "--closed"], "--path"),
    ],
)
def test_floor_says_what_it_expected(tmp_path: Path, arguments: list[str], words: str) -> None:
    done = run("floor", *arguments, "-o", tmp_path / "t.yaml")
    assert done.exit_code == 2
    assert words in done.output
    assert list(tmp_path.iterdir()) == []


CEILING = worlds.ceiling(rows=4, cols=6, height_m=2.5, pitch_m=0.8)
GOOD = """\
frame: map
path: {points_m: [[-1, -1], [1, -1], [1, 1], [-1, 1]], closed: true, std_m: 0.05}
poses:
  - {from_s: 0, to_s: 2, x_m: 0, y_m: -1, z_m: 0.5, yaw_deg: 90, std_m: 0.005}
  - {from_s: 10, to_s: 12, x_m: 1, y_m: 0, z_m: 0.5, yaw_deg: 180, std_m: 0.005}
floor: {square_m: 0.25}
waypoints:
  - {name: 1, row: 4, col: 1, heading_deg: 270, std_m: 0.005}
  - {name: 2, row: 1, col: -4, heading_deg: 0, std_m: 0.005}
"""
FRAMES_S = np.arange(301) / 10
TIMES = LogTimes(FRAMES_S, (Mark("1", 20.0, 22.0, stood=True), Mark("2", 25.0, 25.0, stood=False)))


def found(text: str, marker_map: MarkerMap = CEILING, log: LogTimes | None = None) -> TruthCheck:
    return check_truth(text.encode(), PATH, marker_map, log)


def test_a_good_file_has_no_findings() -> None:
    check = found(GOOD, log=TIMES)
    assert check.findings == ()
    assert (check.sane, len(check.places), check.timed_poses, check.path_points) == (True, 4, 4, 4)


@pytest.mark.parametrize(
    ("old", "new", "severity", "check", "words"),
    [
        ("frame: map", "frame: hall", "error", "file", "'hall'"),
        ("x_m: 1,", "x_m: 1000,", "error", "extent", "pose at 10 s is 998"),
        ("x_m: 1,", "x_m: 7,", "warning", "extent", "further than a camera sees"),
        ("[1, 1]", "[100, 100]", "error", "extent", "path.points_m[2]"),
        ("y_m: 0, z_m: 0.5", "y_m: 0, z_m: 2.6", "error", "height", "behind every marker"),
        ("y_m: 0, z_m: 0.5", "y_m: 0, z_m: -0.5", "warning", "height", "below the floor"),
        ("from_s: 10,", "from_s: 2.1,", "warning", "speed", "1.41 m from 2 s to 2.1 s: 14.1 m/s"),
        ("from_s: 10,", "from_s: 2,", "error", "speed", "at the same time"),
        ("to_s: 2,", "to_s: 11,", "error", "file", "overlap"),
        ("from_s: 0,", "from_s: -1,", "error", "file", "greater than or equal to 0"),
        ("to_s: 12,", "to_s: 31,", "warning", "log", "ends after the log"),
        ("from_s: 10, to_s: 12", "from_s: 40, to_s: 41", "error", "log", "is after the log"),
        ("closed: true, std_m: 0.05", "closed: true, std_m: 5", "warning", "std", "metres?"),
        ("closed: true, std_m: 0.05", "closed: true, std_m: 1e-4", "warning", "std", "0.1 mm"),
        ("heading_deg: 0,", "heading_deg: 90,", "warning", "heading", "waypoint 2 is turned"),
        ("yaw_deg: 180", "yaw_deg: 3.1416", "warning", "heading", "radians"),
        ("yaw_deg: 180", "yaw_deg: 3.14", "warning", "heading", "radians"),
        ("yaw_deg: 180", "yaw_deg: -1.57", "warning", "heading", "radians"),
        ("yaw_deg: 180", "yaw_deg: 540", "warning", "heading", "more than a turn"),
        ("row: 1, col: -4", "row: 1, col: -2", "warning", "path", "waypoint 2 is 0.50 m off"),
        ("row: 1, col: -4", "row: 4, col: 1", "warning", "twice", "waypoint 1 and waypoint 2"),
        ("square_m: 0.25", "square_m: 250", "warning", "square", "metres?"),
        ("square_m: 0.25", "square_m: 0.167", "warning", "square", "1/6 m"),
        ("name: 2", "name: 3", "warning", "marks", "waypoint 2 is marked, and not in the truth"),
        ("name: 2", "name: 3", "note", "marks", "waypoint 3 is never marked"),
    ],
)
def test_each_slip_is_found(old: str, new: str, severity: str, check: str, words: str) -> None:
    assert GOOD.count(old) == 1
    result = found(GOOD.replace(old, new), log=TIMES)
    assert any(
        (f.severity, f.check) == (severity, check) and words in f.text for f in result.findings
    ), result.findings
    assert result.sane == all(f.severity != "error" for f in result.findings)


def test_every_mistake_of_a_file_is_told() -> None:
    result = found("path: {points_m: [[0, 0]]}\nposes: [{from_s: 0}]\nwaypoint: []\n")
    assert result.count("error") >= 6
    assert not result.sane


def test_spans_out_of_order_and_marks_that_say_little() -> None:
    lines = GOOD.splitlines(keepends=True)
    lines[3], lines[4] = lines[4], lines[3]
    marks = (
        Mark("1", 20.0, 20.3, stood=True),
        Mark("2", 25.0, None, stood=True),
        Mark("1", 27.0, 27.0, stood=False, undone=True),
    )
    texts = [f.text for f in found("".join(lines), log=LogTimes(FRAMES_S, marks)).findings]
    assert len(texts) == 3
    assert any("poses[1] begins at 0 s, before the one above it" in text for text in texts)
    assert any("standing still at 1 from 20.000 to 20.300 lasts 0.3 s only" in t for t in texts)
    assert any("standing still at 2 from 25.000 was not ended" in text for text in texts)


def test_places_without_an_image_are_told() -> None:
    """The camera was lost from 19.5 s to 25.05 s, and came back within the second mark."""
    lost = (FRAMES_S > 19.5) & (FRAMES_S < 25.05)
    (finding,) = found(GOOD, log=LogTimes(FRAMES_S[~lost], TIMES.marks)).findings
    assert (finding.severity, finding.where) == ("warning", "pose at 20 s")
    assert "no image from 20 s to 22 s, the nearest is 1.50 s away" in finding.text
    assert "waypoint 1" in finding.text


def test_small_headings_are_degrees() -> None:
    for angle in (0, 0.001, 1.5, 3, 5, 45):
        texts = [f.text for f in found(GOOD.replace("yaw_deg: 180", f"yaw_deg: {angle}")).findings]
        assert not any("radians" in text for text in texts), angle


def test_exact_squares_are_no_slip() -> None:
    for side in ("0.16666666666666666", "0.166666667", "0.25", "0.3", "0.5", "0.2", "0.125"):
        checks = [
            f.check for f in found(GOOD.replace("square_m: 0.25", f"square_m: {side}")).findings
        ]
        assert "square" not in checks, side


def test_markers_on_a_floor_are_seen_from_above() -> None:
    floor = MarkerMap(
        "map",
        "DICT_6X6_1000",
        tuple(Marker.from_yaw(i, (i % 3 - 1, i // 3 - 1, 0.0), 0.0, "up", 0.15) for i in range(9)),
    )
    assert not [f for f in found(GOOD, floor).findings if f.check in ("height", "extent")]
    assert found(GOOD.replace("y_m: 0, z_m: 0.5", "y_m: 0, z_m: -0.1"), floor).count("error") == 1


def test_a_trajectory_is_checked_as_a_whole() -> None:
    csv = "timestamp_ns,x_m,y_m,z_m\n" + "".join(
        f"{n}00000000,{x},0,{z}\n" for n, x, z in [(3, 0.2, 1), (1, 0, 1), (2, 0.1, 3), (4, 9, 1)]
    )
    check = check_truth(csv.encode(), Path("t.csv"), CEILING)
    texts = {f.check: f.text for f in check.findings}
    assert "1 of 4 poses; the first is at a height of 3.00 m" in texts["height"]
    assert "1 of 4 poses; the first is 7.00 m outside" in texts["extent"]
    assert "not in order from line 3 on" in texts["order"]
    assert "1 of 3 steps" in texts["speed"]
    assert "88.0 m/s" in texts["speed"]


def test_the_verdict_is_the_exit_code(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_bytes(map_yaml(CEILING))
    truth = tmp_path / "truth.yaml"
    outcomes = []
    for old, new in (("x", "x"), ("x_m: 1,", "x_m: 7,"), ("x_m: 1,", "x_m: 999,")):
        truth.write_text(GOOD.replace(old, new))
        for strict in ([], ["--strict"]):
            done = run("check", truth, "--map", tmp_path / "map.yaml", "--json", *strict)
            content = json.loads(done.output)
            outcomes.append((content["sane"], done.exit_code))
    assert outcomes == [(True, 0), (True, 0), (True, 0), (True, 1), (False, 1), (False, 1)]
    text = run("check", truth, "--map", tmp_path / "map.yaml").output
    assert text.splitlines()[-1].endswith("2 timed poses, 1 error, 2 warnings")
    assert run("check", truth).exit_code == 2
    missing = run("check", tmp_path / "none.yaml")
    assert isinstance(missing.exception, InputError)
    assert "none.yaml" in str(missing.exception)


MARKED = b"""\
frame: map
method: counted
path: {points_m: [[0, 0], [1, 0]], std_m: 0.05}
poses: [{from_s: 0, to_s: 0.5, x_m: 1, y_m: 1, std_m: 0.01}]
floor: {square_m: 0.5}
waypoints:
  - {name: 1, row: 1, col: 2, heading_deg: 30, std_m: 0.005}
  - {name: b, row: 0, col: 0, std_m: 0.005}
"""


def marked(path: Path, lost: Collection[int] = ()) -> Path:
    files = {**attachments(), "truth.yaml": MARKED}
    texts = {
        10: "standing still at 1 from 1.000",
        20: "standing still at 1 from 1.000 to 2.000",
        22: "arrived at b",
        24: "arrived at c",
    }
    with LogWriter(path, attachments=files, session={}) as writer:
        for i in range(30):
            item = frame(i, size=100)
            if i not in lost:
                writer.write_frame(item)
            if i in texts:
                writer.write_event(item.timestamp_ns, "info", texts[i], name="operator")
    return path


def test_marks_become_a_file_with_times(tmp_path: Path) -> None:
    log, out = marked(tmp_path / "x.mcap"), tmp_path / "timed.yaml"
    done = run("marks", log, "-o", out)
    assert done.exit_code == 0, done.output
    assert "waypoint c is marked, and not in the truth, which has 1, b" in done.stderr
    assert done.stdout.splitlines()[:3] == [
        "stood at 1    1.000 s to 2.000 s",
        "arrived at b  2.200 s",
        "arrived at c  2.400 s",
    ]
    truth = parse_truth(out.read_bytes(), out)
    assert truth.waypoints == ()
    assert (truth.frame, truth.method) == ("map", "counted")
    assert truth.path is not None
    assert [(p.name, p.from_s, p.to_s, p.x_m, p.y_m) for p in truth.poses] == [
        (None, 0.0, 0.5, 1.0, 1.0),
        ("1", 1.0, 2.0, 1.0, 0.5),
        ("b", 2.1, 2.3, 0.0, 0.0),
    ]
    assert truth.poses[1].yaw_rad == pytest.approx(math.radians(30))
    # As a replay would use it.
    content = json.loads(run("marks", log, "--json").stdout)
    assert [pose["from_s"] for pose in content["poses"]] == [0.0, 1.0, 2.1]
    assert [mark["name"] for mark in content["marks"]] == ["1", "b", "c"]


def test_marks_while_the_camera_was_lost_are_told(tmp_path: Path) -> None:
    """From the command line: of the span from 1 s to 2 s there is no image, of 2.2 s there is."""
    log, truth = marked(tmp_path / "x.mcap", lost=range(9, 22)), tmp_path / "truth.yaml"
    truth.write_bytes(MARKED)
    (tmp_path / "map.yaml").write_bytes(map_yaml(CEILING))
    for done in (
        run("marks", log),
        run("check", truth, "--map", tmp_path / "map.yaml", "--log", log),
    ):
        assert done.exit_code == 0, done.output
        assert done.output.count("no image from") == 1
        assert (
            "no image from 1 s to 2 s, the nearest is 0.70 s away: the pose of wayp" in done.output
        )
    assert "no image" not in run("marks", marked(tmp_path / "y.mcap")).output


def test_marks_need_waypoints_to_be_timed(tmp_path: Path) -> None:
    log, out = marked(tmp_path / "x.mcap"), tmp_path / "timed.yaml"
    other = tmp_path / "other.yaml"
    other.write_text("path: {points_m: [[0, 0], [1, 0]], std_m: 0.05}\n")
    done = run("marks", log, "--truth", other, "-o", out)
    assert done.exit_code == 1
    assert isinstance(done.exception, InputError)
    assert "expected a truth with waypoints" in str(done.exception)
    other.write_text("waypoints: [{name: z, x_m: 0, y_m: 0, std_m: 0.05}]\n")
    done = run("marks", log, "--truth", other, "-o", out)
    assert "expected marks of the truth's waypoints" in str(done.exception)
    assert not out.exists()
    assert run("marks", log, "--truth", other).exit_code == 0


def test_check_takes_map_and_marks_from_a_log(tmp_path: Path) -> None:
    log = marked(tmp_path / "x.mcap")
    (tmp_path / "truth.yaml").write_bytes(MARKED.replace(b"name: b", b"name: c"))
    done = run("check", tmp_path / "truth.yaml", "--log", log, "--json")
    assert done.exit_code == 0, done.output
    content = json.loads(done.output)
    texts = [f["text"] for f in content["findings"]]
    assert "waypoint b is marked, and not in the truth, which has 1, c" in texts
    assert content["timed_poses"] == 3
