"""settings.yaml: one replay's settings, resolved from a file, overrides and defaults."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from pipeline.localizer import PipelineSettings
from recorder.errors import InputError
from recorder.files.yaml_file import load_yaml, parse_yaml, validate
from replay.variance_file import resolve_tables


def load_settings(path: Path | None, overrides: Iterable[str] = ()) -> PipelineSettings:
    """The settings of a file (None: the paper's), with `key.key=value` overrides on top.

    A variance model's `path: table.yaml` becomes the table in that file: relative to the settings
    file, or to the current folder in an override.

    Raises:
        InputError: names the file or the override, the key, what was expected and what was found.
    """
    source = path or Path("the paper's settings")
    data = {} if path is None else load_yaml(path)
    data = resolve_tables({} if data is None else data, source, source.parent)
    settings = validate(PipelineSettings, data, source)
    for override in overrides:
        settings = _override(settings, override)
    return settings


def _override(settings: PipelineSettings, override: str) -> PipelineSettings:
    place = Path(f"--set {override}")
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise InputError(place, "expected KEY=VALUE such as pose.max_markers=3")
    value = parse_yaml(text.encode(), place)
    whole = settings.model_dump(mode="json")
    node: Any = whole
    *parents, last = key.strip().split(".")
    for depth, name in enumerate(parents):
        if not isinstance(node, dict) or not isinstance(node.get(name), dict):
            known = ", ".join(node) if isinstance(node, dict) else "nothing below it"
            raise InputError(place, f"expected one of: {known}", ".".join(parents[: depth + 1]))
        node = node[name]
    node[last] = value
    return validate(PipelineSettings, resolve_tables(whole, place, Path(), replace=True), place)


def settings_yaml(settings: PipelineSettings, versions: dict[str, str]) -> bytes:
    """A settings.yaml that `load_settings` reads back; the versions are comments."""
    header = "".join(f"# {name}: {version}\n" for name, version in versions.items())
    body: str = yaml.safe_dump(
        settings.model_dump(mode="json"), sort_keys=False, default_flow_style=None, width=100
    )
    return (header + body).encode()


def digest(settings: PipelineSettings, **others: str | float | None) -> str:
    """SHA-256 (hex) of the resolved settings and of what else makes a replay another one."""
    content = {
        "settings": settings.model_dump(mode="json"),
        **{name: value for name, value in others.items() if value is not None},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
