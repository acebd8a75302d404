"""The sample log: every part of the format is in it, and a replay gives what is expected."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from recorder.info import log_info
from recorder.log.reader import LogReader
from recorder.log.records import ExactPose, LogEvent, LogImage
from tests.make_sample import EXPECTED, LOG, replayed


def test_it_is_small_and_has_every_part_of_the_format() -> None:
    assert LOG.stat().st_size < 8_000_000
    with LogReader(LOG) as reader:
        assert set(reader.attachments) == {"camera.yaml", "map.yaml", "truth.yaml"}
        assert "session" in reader.metadata
        truth = reader.truth()
        assert truth is not None
        assert truth.path is not None
        assert truth.poses
        kinds = {type(record) for record in reader.records()}
        assert kinds == {LogImage, ExactPose, LogEvent}
        topics = {channel.topic for _, channel, _ in reader.messages()}
        assert topics == {
            "/camera/image",
            "/camera/calibration",
            "/tf",
            "/truth/path",
            "/truth/pose",
            "/truth/exact",
            "/events",
        }
        assert reader.cut_short is None
    found = log_info(LOG).as_dict()
    assert "complete" in json.dumps(found)


def assert_close(found: Any, expected: Any, where: str = "") -> None:
    """Equal in shape; numbers within what another OpenCV build may change."""
    if isinstance(expected, dict):
        assert set(found) == set(expected), where
        for key, value in expected.items():
            assert_close(found[key], value, f"{where}.{key}")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=0.02, abs=1e-4), where
    else:
        assert found == expected, where


def test_a_replay_gives_the_expected_results(tmp_path: Path) -> None:
    assert_close(replayed(tmp_path), json.loads(EXPECTED.read_text()))


def test_the_adaptive_model_follows_the_path_best(tmp_path: Path) -> None:
    """What the sample is there to show, as the paper found it."""
    path = replayed(tmp_path)["errors"]["path"]
    rms = {name: error["rms_m"] for name, error in path.items()}
    assert min(rms, key=lambda name: rms[name]) == "adaptive"
