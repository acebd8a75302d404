"""Files that commands write: named as what they are."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from arucolog import cli
from recorder.errors import InputError
from recorder.files.output_file import check_free, check_suffix, write_together, write_whole

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


def test_a_folder_that_is_read_only_is_found_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: path != tmp_path)
    with pytest.raises(InputError, match=r"a.yaml: expected to write to the folder .* read-only"):
        check_free(tmp_path / "a.yaml", force=True)


@pytest.mark.parametrize("refused", ["write_bytes", "replace"])
def test_what_cannot_be_written_is_named_as_it_was_asked_for(
    refused: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A read-only disk refuses to remove as well, even what is not there."""
    path = tmp_path / "a.pdf"

    def refuse(self: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))

    monkeypatch.setattr(Path, refused, refuse)
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(OSError, match="Read-only") as whole:
        write_whole(path, b"1")
    with pytest.raises(OSError, match="Read-only") as together:
        write_together({path: b"1"}, force=False)
    for caught in (whole.value, together.value):
        assert caught.filename == str(path)
        assert ".part" not in str(caught)
