"""The command line: help, exit codes, one-line errors, and a README that names every verb."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from arucolog import cli
from tests import worlds

ROOT = Path(__file__).resolve().parents[1]
VERBS = ["init", "record", "replay", "compare", "view", "info", "attach", "demo"]
VERBS += ["analyze", "report", "export", "calibrate", "cameras", "map", "markers"]
VERBS += ["recover", "track", "truth", "verify"]


def arucolog(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The command as a user calls it."""
    return subprocess.run(
        [sys.executable, "-m", "arucolog", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        timeout=120,
    )


def test_the_verbs_are_the_designs() -> None:
    assert set(cli.commands) == set(VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_that_ends_in_a_worked_example(verb: str) -> None:
    command = cli.commands[verb]
    text = command.get_help(click.Context(command, info_name=f"arucolog {verb}"))
    *_, title, example = text.strip().splitlines()
    assert title.strip() == "Example:"
    assert example.strip().startswith(f"arucolog {verb}")
    assert all(p.help for p in command.params if isinstance(p, click.Option)), verb


@pytest.mark.parametrize("verb", VERBS)
def test_the_readme_names_every_verb(verb: str) -> None:
    assert f"arucolog {verb}" in (ROOT / "README.md").read_text()


def test_help_is_instant() -> None:
    """The best of five, for machines that are busy with other things."""
    seconds = []
    for _ in range(5):
        started = time.perf_counter()
        assert arucolog("--help").returncode == 0
        seconds.append(time.perf_counter() - started)
    assert min(seconds) < 0.3


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return worlds.small_log(tmp_path_factory.mktemp("cli") / "drive.mcap", 6)


def test_a_session_from_log_to_comparison(log: Path) -> None:
    folder = log.parent
    done = arucolog("replay", log.name, "--no-rrd", cwd=folder)
    assert done.returncode == 0
    # The drawn robot starts at full speed, which no filter of the paper follows.
    assert done.stderr.startswith("Warning: drive.mcap: further from the truth than the fixes")
    assert len(done.stderr.splitlines()) == 1
    done = arucolog(
        "replay", log.name, "--no-rrd", "--set", "pose.max_markers=2", "--name", "two", cwd=folder
    )
    assert done.returncode == 0
    results = sorted((folder / "drive.results").iterdir())
    assert [r.name[:8] for r in results] == ["default-", "two"]
    assert len(results[0].name) == len("default-") + 8
    done = arucolog("compare", *results)
    assert done.returncode == 0
    assert "pose.max_markers" in done.stdout
    table = json.loads(arucolog("compare", *results, "--json").stdout)
    assert len(table) == 12
    assert json.loads(arucolog("info", log, "--json").stdout)


def test_several_logs_go_into_folders_of_their_names(log: Path, tmp_path: Path) -> None:
    other = worlds.small_log(tmp_path / "other.mcap", 3)
    done = arucolog("replay", log, other, "--no-rrd", "-o", tmp_path / "out", "--json")
    assert done.returncode == 0
    summaries = json.loads(done.stdout)
    assert [(s["log"], s["frames"]) for s in summaries] == [("drive.mcap", 6), ("other.mcap", 3)]
    assert (tmp_path / "out/drive/poses.parquet").exists()
    assert (tmp_path / "out/other/poses.parquet").exists()
    # Two logs of one name would overwrite each other.
    again = tmp_path / "again"
    again.mkdir()
    worlds.small_log(again / "drive.mcap", 1)
    done = arucolog("replay", log, again / "drive.mcap", "--no-rrd", "-o", tmp_path / "both")
    assert done.returncode == 1
    assert not (tmp_path / "both").exists()


def test_a_cut_log_warns_and_succeeds(tmp_path: Path) -> None:
    data = worlds.small_log(tmp_path / "whole.mcap", 20).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) * 2 // 3])
    done = arucolog("replay", cut, "--no-rrd")
    assert done.returncode == 0
    assert "Warning" in done.stderr
    assert "cut short" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "part"),
    [
        (["replay", "none.mcap"], 1, "none.mcap: expected an MCAP log, found no file"),
        (["replay", "{log}", "--settings", "none.yaml"], 1, "none.yaml: expected a file"),
        (["replay", "{log}", "--set", "pose.max=3"], 1, "max_markers"),
        (["replay", "{log}", "--camera", "none.yaml"], 1, "none.yaml: expected a file"),
        (["replay", "{log}", "--from", "5", "--to", "4"], 2, "--to"),
        (["replay"], 2, "LOG"),
        (["replay", "{log}", "--name", "../up"], 1, "plain name"),
        (["replay", "{log}", "--name", ".."], 1, "plain name"),
        (["replay", "{log}", "none.mcap", "-o", "out"], 1, "none.mcap"),
        (
            ["replay", "{log}", "--set", "detector.parameters.minMarkerPerimeterRate=-3"],
            1,
            "OpenCV",
        ),
        (["compare", "none"], 1, "none: expected a folder made by `arucolog replay`"),
        (["info", "none.mcap"], 1, "none.mcap"),
        (["record", "none.mp4"], 1, "none.mp4"),
        (["attach", "{log}", "-o", "x.mcap"], 2, "--truth"),
        (["frobnicate"], 2, "frobnicate"),
        (["replay", "{log}", "--frobnicate"], 2, "--frobnicate"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    arguments: list[str], code: int, part: str, log: Path, tmp_path: Path
) -> None:
    done = arucolog(*(a.replace("{log}", str(log)) for a in arguments), cwd=tmp_path)
    assert done.returncode == code
    assert part in done.stderr
    assert "Traceback" not in done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("Error")]
    assert len(errors) == 1
    assert not list(tmp_path.iterdir())
