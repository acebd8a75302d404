"""YAML, read strictly: a mistake is one line with the file, the key and what was expected."""

from __future__ import annotations

import re
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from pipeline.settings import Settings
from recorder.errors import InputError
from recorder.files.file_kinds import other_kind
from recorder.files.text import text_of

try:
    from yaml import CSafeLoader as _SafeLoader
except ImportError:  # PyYAML without libyaml: the same, slower
    from yaml import SafeLoader as _SafeLoader  # type: ignore[assignment]

Model = TypeVar("Model", bound=BaseModel)


class FileModel(Settings):
    """The shape of a file: no text where a number belongs, no `yes` where a length belongs."""

    model_config = ConfigDict(strict=True)


class _Loader(_SafeLoader):
    """The safe loader without PyYAML's two surprises: the last of equal keys wins, 1e-3 is text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge" or not isinstance(
                key_node, yaml.ScalarNode
            ):
                continue
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"expected each key once, found {key_node.value!r} again",
                    key_node.start_mark,
                )  # fmt: skip
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    """Quotes what the loader would not take for text."""


_NUMBER = re.compile(r"^[-+]?(?:[0-9]+|[0-9]*\.[0-9]+|[0-9]+\.)[eE][-+]?[0-9]+$")
for _side in (_Loader, _Dumper):
    _side.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, list("-+.0123456789"))


def inline_yaml(value: Any) -> str:
    """A value in one line, as `parse_yaml` reads it back."""
    options: dict[str, Any] = {"default_flow_style": True, "width": 10**6, "sort_keys": False}
    text: str = yaml.dump(value, Dumper=_Dumper, allow_unicode=True, **options)
    # PyYAML leaves line breaks as they are that are none in ASCII.
    if yaml.load(text, _Loader) != value:
        text = yaml.dump(value, Dumper=_Dumper, **options)
    return text.removesuffix("\n").removesuffix("\n...")


def parse_yaml(data: bytes, path: Path) -> Any:
    """The one document in `data`; None when there is nothing in it.

    Args:
        path: where the bytes come from, for the message.

    Raises:
        InputError: not UTF-8, not YAML, or a key twice; names the line.
    """
    text = text_of(data, path)
    if text.startswith("%YAML:"):
        raise InputError(
            path, "expected YAML, found OpenCV's own form of it (%YAML:1.0); `arucolog init` "
            "writes a camera.yaml to put a calibration's numbers into",
        )  # fmt: skip
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = error.problem or error.context or "not YAML"
        problem = problem.removeprefix("found ")
        if problem == "but found another document":
            problem = "expected one document, found another"
        if not problem.startswith("expected"):
            problem = f"expected YAML, found: {problem}"
        raise InputError(path, problem, f"line {mark.line + 1}" if mark else None) from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(
            path, "expected text, found a control character", f"line {line}"
        ) from error
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise InputError(path, f"expected YAML, found: {error}") from error


def load_yaml(path: Path) -> Any:
    """`parse_yaml` of a file.

    Raises:
        InputError: also when the file cannot be read.
    """
    return parse_yaml(read_bytes(path), path)


def read_bytes(path: Path, limit: int = -1) -> bytes:
    """The bytes of a file that a person named, the first `limit` where that is given.

    Raises:
        InputError: it is not there, is a folder, or may not be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(limit)
    except FileNotFoundError as error:
        raise InputError(path, "expected a file, found none") from error
    except IsADirectoryError as error:
        raise InputError(path, "expected a file, found a folder") from error
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(path, f"expected a readable file, found: {reason}") from error


def validate(model: type[Model], data: Any, path: Path) -> Model:
    """`data` as a `model`.

    Raises:
        InputError: names the file, the key (`markers[3].xyz_m`), what was expected and found.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        if other := other_kind(data, model.model_fields, path):
            raise other from error
        details = error.errors(include_url=False)
        # A misspelled key is also a missing one: the spelling is the better news.
        first = next((d for d in details if d["type"] == "extra_forbidden"), details[0])
        where = _where(first, data)
        more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
        raise InputError(path, _problem(model, first) + more, where) from error


def problems(model: type[BaseModel], data: Any, path: Path) -> list[InputError]:
    """Everything that keeps `data` from being a `model`, each as `validate` would say it."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        if other := other_kind(data, model.model_fields, path):
            return [other]
        details = error.errors(include_url=False)
        return [InputError(path, _problem(model, d), _where(d, data)) for d in details]
    return []


def _where(error: ErrorDetails, data: Any) -> str | None:
    """The key as a person writes it, without the tags of unions that pydantic puts in between."""
    text = ""
    value = data
    last = len(error["loc"]) - 1
    tagged = False
    for i, part in enumerate(error["loc"]):
        # The tag of a union may also be the name of a field: it comes first.
        if isinstance(value, dict) and value.get("kind") == part and not tagged:
            tagged = i < last
            if tagged:
                continue
        tagged = False
        if isinstance(part, int):
            text += f"[{part}]"
            value = value[part] if isinstance(value, list | tuple) and part < len(value) else None
        elif isinstance(value, dict) and part in value:
            text += f".{part}"
            value = value[part]
        elif i == last and error["type"] == "missing":
            text += f".{part}"
    return text.lstrip(".") or None


def _problem(model: type[BaseModel], error: ErrorDetails) -> str:
    kind, message, context = error["type"], error["msg"], error.get("ctx", {})
    if kind == "extra_forbidden":
        known = _known_keys(model, error["loc"])
        near = get_close_matches(str(error["loc"][-1]), known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
        return f"expected a known key, found {str(error['loc'][-1])!r}; {hint}"
    if kind == "missing":
        return "expected this key, found none"
    if kind == "value_error":
        return message.removeprefix("Value error, ")
    found = shown(error["input"])
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"expected keys and values, found {found}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        expected = context.get("expected_tags", f"the key {context.get('discriminator')}")
        return f"expected {expected}, found {context.get('tag', found)}"
    if kind in ("too_short", "too_long"):
        bound, limit = ("least", "min_length") if kind == "too_short" else ("most", "max_length")
        return f"expected at {bound} {context[limit]} items, found {context['actual_length']}"
    for prefix in ("Input should be ", "Input should have ", "Input should "):
        if message.startswith(prefix):
            expected = message.removeprefix(prefix).replace("a valid ", "a ")
            expected = expected.replace("a string", "text").replace("a integer", "an integer")
            return f"expected {expected}, found {found}"
    return f"expected something else: {message}, found {found}"


def shown(value: Any) -> str:
    """A value in a message."""
    if value is None:
        return "nothing"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _known_keys(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """The keys of the model (or models of a union) that holds the last part of `loc`."""
    models = [model]
    for part in loc[:-1]:
        tagged = [m for m in models if part in _tags(m)]
        if len(models) > 1 and tagged:
            models = tagged
            continue
        annotations = [m.model_fields[part].annotation for m in models if part in m.model_fields]
        if annotations:
            models = [found for annotation in annotations for found in _models_in(annotation)]
    return list(dict.fromkeys(name for m in models for name in m.model_fields))


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in get_args(annotation) for found in _models_in(part)]


def _tags(model: type[BaseModel]) -> tuple[Any, ...]:
    return tuple(tag for f in model.model_fields.values() for tag in get_args(f.annotation))
