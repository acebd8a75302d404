"""Files that commands write: named as what they are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from arucolog import cli
from recorder.errors import InputError
from recorder.files.output_file import check_suffix

# What is wrong is only the suffix; what is read does not exist, and is never looked for.
WRONG = {
    "record none.mp4": ("-o", "x.mp4", ".mcap"),
    "track none.mp4": ("-o", "x.txt", ".mcap"),
    "attach none.mcap --map none.yaml": ("-o", "x", ".mcap"),
    "recover none.mcap": ("-o", "x.bag", ".mcap"),
    "map import none.json": ("-o", "x.json", ".yaml or .yml"),
    "map export none.yaml": ("-o", "x.yaml", ".json (wpilib), .txt (fiducial_slam), .csv (csv)"),
    "map draw none.yaml": ("-o", "x.jpg", ".svg, .pdf or .png"),
    "map survey none.mcap": ("-o", "x.txt", ".yaml or .yml"),
    "truth floor 0,0 --square-m 1": ("-o", "x.csv", ".yaml or .yml"),
    "truth marks none.mcap": ("-o", "x.csv", ".yaml or .yml"),
    "markers --ids 0": ("-o", "x.png", ".pdf"),
    "calibrate none --board chessboard:9x6:0.025": ("-o", "x.txt", ".yaml or .yml"),
    "calibrate none --board chessboard:9x6:0.03": ("--report", "x.yaml", ".html or .htm"),
    "export none --format tum": ("-o", "x.csv", ".tum or .txt"),
    "export none --format kitti": ("-o", "x.tum", ".kitti or .txt"),
    "export none --format csv": ("-o", "x.txt", ".csv"),
    "export none --format mcap": ("-o", "x.rrd", ".mcap"),
    "view none": ("--save", "x.mcap", ".rrd"),
    "report none": ("-o", "x.pdf", ".html or .htm"),
    "analyze variance none": ("-o", "x.csv", ".yaml or .yml"),
}


@pytest.mark.parametrize("verb", WRONG)
def test_a_wrong_suffix_is_one_line_before_any_work(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    option, name, expected = WRONG[verb]
    done = CliRunner().invoke(cli, [*verb.split(), option, name])
    assert isinstance(done.exception, InputError), done.output
    text = str(done.exception)
    assert text.startswith(f"{name}: expected {expected}")
    assert f"found {Path(name).suffix or 'no suffix'}" in text
    assert done.output == ""
    assert list(tmp_path.iterdir()) == []


def file_options(group: click.Group, path: str = "") -> Iterator[tuple[str, str]]:
    """Verb and option, for options that name a file to write."""
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            yield from file_options(command, f"{path}{name} ")
            continue
        for parameter in command.params:
            writes = {"--output", "--report", "--save"} & set(parameter.opts)
            if writes and isinstance(parameter.type, click.Path) and parameter.type.file_okay:
                yield f"{path}{name}", parameter.opts[0]


def test_every_verb_that_writes_a_file_is_tried() -> None:
    assert isinstance(cli, click.Group)
    options = set(file_options(cli))
    tried = {
        (verb, option)
        for verb, option in options
        for line, (tried_option, _, _) in WRONG.items()
        if line.startswith(f"{verb} ") and tried_option == option
    }
    assert len(tried) > 15
    assert options - tried == set()


def test_either_case_will_do_and_nothing_is_no_file() -> None:
    check_suffix(Path("drive.MCAP"), [".mcap"])
    check_suffix(Path("hall.north.yml"), [".yaml", ".yml"])
    check_suffix(None, [".mcap"])
    for name in (".mcap", "mcap", "drive.mcap.bak"):
        with pytest.raises(InputError):
            check_suffix(Path(name), [".mcap"])
