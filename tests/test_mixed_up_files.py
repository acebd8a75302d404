"""A file that is given where another belongs is named as what it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from recorder.errors import InputError
from recorder.files.camera_file import parse_camera
from recorder.files.map_file import parse_map, read_map
from recorder.files.truth_file import parse_truth, truth_problems
from recorder.files.yaml_file import parse_yaml
from recorder.map_cli import map_group
from recorder.maps.formats import MapDefaults, import_map
from recorder.simulation.scene_file import load_scene, shipped_scenes
from recorder.templates import CeilingGrid, write_templates
from replay.settings_file import load_settings

NAMES = {
    "camera.yaml": ("a camera calibration", "--camera"),
    "map.yaml": ("a marker map", "--map"),
    "truth.yaml": ("a ground truth", "--truth"),
    "settings.yaml": ("settings of a replay", "--settings"),
    "scene.yaml": ("a scene", "arucolog record"),
}
READERS: dict[str, Callable[[Path], object]] = {
    "camera.yaml": lambda path: parse_camera(path.read_bytes(), path),
    "map.yaml": lambda path: parse_map(path.read_bytes(), path),
    "truth.yaml": lambda path: parse_truth(path.read_bytes(), path),
    "settings.yaml": load_settings,
    "scene.yaml": load_scene,
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One good file of each kind."""
    write_templates(tmp_path, CeilingGrid(2, 2, 1.0, 2.5, 0.15, "DICT_6X6_1000"), force=False)
    scene = next(iter(shipped_scenes().values()))
    (tmp_path / "scene.yaml").write_bytes(scene.read_bytes())
    return tmp_path


@pytest.mark.parametrize("wanted", NAMES)
@pytest.mark.parametrize("given", NAMES)
def test_every_kind_given_as_every_other(folder: Path, wanted: str, given: str) -> None:
    if wanted == given:
        if given != "scene.yaml":
            READERS[wanted](folder / given)
        return
    with pytest.raises(InputError) as caught:
        READERS[wanted](folder / given)
    name, belongs = NAMES[given]
    text = str(caught.value)
    assert text.startswith(f"{folder / given}: expected {NAMES[wanted][0]}, found {name} (")
    assert belongs in text


def test_checks_that_list_every_mistake_name_this_one_alone(folder: Path) -> None:
    camera, truth = folder / "camera.yaml", folder / "truth.yaml"
    with pytest.raises(InputError, match="expected a marker map, found a camera calibration"):
        read_map(camera.read_bytes(), camera)
    (found,) = truth_problems(camera.read_bytes(), camera)
    assert "expected a ground truth, found a camera calibration" in str(found)
    checked = CliRunner().invoke(map_group, ["check", str(truth)])
    assert "found a ground truth" in str(checked.exception)
    assert checked.output == ""


def test_a_mistake_in_the_right_file_is_named_as_before() -> None:
    """Whatever else is in it: a file with a key of its own kind is of that kind."""
    path = Path("map.yaml")
    with pytest.raises(InputError, match=r"pose: expected a known key, found 'pose'"):
        parse_map(b"{dictionary: DICT_4X4_50, pose: {}, markers: []}", path)
    with pytest.raises(InputError, match=r"makers: .* did you mean markers\?"):
        parse_map(b"{frame: map, makers: []}", path)
    with pytest.raises(InputError, match="expected keys and values, found nothing"):
        parse_map(b"", path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"{width: 640, height: 480, distortion_model: plumb_bob, k: [], d: []}", "a CameraInfo"),
        (b"{width: 640, height: 480, K: [], D: []}", "arucolog init"),
        (b"cam0: {camera_model: pinhole, intrinsics: [1, 1, 1, 1]}", "Kalibr"),
        (b"%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n", "OpenCV"),
    ],
)
def test_calibrations_in_other_forms_are_known(content: bytes, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_camera(content, Path("camera.yaml"))
    assert words in str(caught.value)
    assert "found" in str(caught.value)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\x89MCAP0\r\n\x01", "expected a text file, found an MCAP log"),
        ("frame: map\n".encode("utf-16"), "found UTF-16: save it as UTF-8"),
        ("a: 1\nb: \xb5m\n".encode("latin-1"), "line 2: expected UTF-8 text, found byte 0xb5"),
    ],
)
def test_bytes_that_are_no_text_are_named(data: bytes, words: str) -> None:
    for parse in (parse_map, parse_camera, parse_yaml):
        with pytest.raises(InputError, match=words):
            parse(data, Path("map.yaml"))
    with pytest.raises(InputError, match=words):
        import_map(data, Path("a.json"), "wpilib", MapDefaults())


def test_several_documents_are_said() -> None:
    with pytest.raises(InputError, match="line 2: expected one document, found another"):
        parse_yaml(b"a: 1\n---\nb: 2\n", Path("x.yaml"))
