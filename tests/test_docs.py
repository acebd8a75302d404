"""What the documents promise: commands and examples run, what they name exists."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.log.reader import LogReader
from recorder.log.records import LogImage
from tests.test_cli import arucolog

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


def readme_commands() -> list[str]:
    """Every `arucolog` line of the README's shell blocks, in order."""
    blocks = re.findall(r"```sh\n(.*?)```", README, flags=re.S)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("arucolog ")]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the README's session starts from, taken from the sample log."""
    folder = tmp_path_factory.mktemp("site")
    with LogReader(ROOT / "logs/sample.mcap") as reader:
        for name in ("camera.yaml", "map.yaml"):
            (folder / name).write_bytes(reader.attachments[name])
        images = [r for r in reader.records(to_s=3.0) if isinstance(r, LogImage)]
    video = cv2.VideoWriter(
        str(folder / "drive.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, (960, 540)
    )
    (folder / "images").mkdir()
    for image in images:
        decoded = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        video.write(decoded)
        (folder / "images" / f"{image.frame_index:03}.jpg").write_bytes(image.data)
    video.release()
    (folder / "truth.csv").write_text(
        "frame_index,x_m,y_m,z_m,qx,qy,qz,qw\n0,0.6,0.4,0.25,0,0,0,1\n"
    )
    (folder / "logs").mkdir()
    return folder


@pytest.mark.slow
def test_every_readme_command_runs(site: Path) -> None:
    two = re.search(r"```yaml\n# two\.yaml\n(.*?)```", README, flags=re.S)
    assert two is not None
    (site / "two.yaml").write_text(two.group(1))
    commands = readme_commands()
    assert len(commands) >= 12
    for command in commands:
        _, *arguments = shlex.split(command)
        if arguments[0] == "view":
            # A window is more than a test can open.
            arguments += ["--save", "view.rrd"]
        done = arucolog(*arguments, cwd=site)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    assert (site / "view.rrd").stat().st_size > 100_000
    assert (site / "logs/drive.results/two/replay.rrd").exists()


def test_examples_run(site: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "examples/localize_images.py", "images", "camera.yaml", "map.yaml"],
        cwd=site,
        env={"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 30
    assert all(": ok, " in line for line in lines)


def test_the_templates_replay_as_they_are(site: Path, tmp_path: Path) -> None:
    assert arucolog("init", "t", cwd=tmp_path).returncode == 0
    done = arucolog(
        *("replay", ROOT / "logs/sample.mcap", "--settings", tmp_path / "t/settings.yaml"),
        *("--to", "0.5", "--no-rrd", "-o", tmp_path / "r"),
    )
    assert done.returncode == 0, done.stderr


def test_documents_link_to_files_that_exist() -> None:
    for document in ("README.md", "ARCHITECTURE.md", "logs/README.md"):
        text = (ROOT / document).read_text()
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
            assert (ROOT / document).parent.joinpath(target).exists(), f"{document}: {target}"


def test_architecture_names_rooms_that_exist() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text()
    for path in re.findall(r"`((?:pipeline|recorder|replay|analysis)/[\w/.]+)`", text):
        assert (ROOT / path).exists(), path


def test_the_demo_replaces_an_earlier_one(tmp_path: Path) -> None:
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo/hard.mcap").write_bytes(b"an earlier demo")
    (tmp_path / "demo/notes.txt").write_text("mine")
    done = arucolog("demo", "-o", tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    assert "adaptive" in done.stdout
    assert done.stdout.strip().endswith("replay.rrd")
    assert (tmp_path / "demo/sample/replay.rrd").exists()
    assert (tmp_path / "demo/notes.txt").exists()
