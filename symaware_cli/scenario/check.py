"""From pydantic's errors to located problems in the words of the scenario file."""

from __future__ import annotations

import json
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from symaware_cli.scenario.compose import Composition
from symaware_cli.scenario.problem import Problem, dotted, nearest, quoted
from symaware_cli.scenario.source import Path

AnyModel = TypeVar("AnyModel", bound=BaseModel)

_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_parsing": "a number",
    "int_parsing": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "none_required": "null",
}
_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def check(model: type[AnyModel], data: Any, composition: Composition, path: Path) -> AnyModel | list[Problem]:
    """Validate data that stand at a path of a document.

    Numbers are not made of text nor flags of numbers: what is of the wrong type is wrong.

    Returns:
        The validated model, or every problem with the data.
    """
    try:
        return model.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        details = error.errors(include_url=False)
    problems = [_problem(model, data, composition, path, each) for each in details]
    # A union reports one error for each of its branches; the place counts once, and its first complaint is shown.
    first = {
        (problem.path, problem.code == "missing-field" and problem.message): problem for problem in reversed(problems)
    }
    return list(reversed(first.values()))


def _problem(model: type[BaseModel], data: Any, composition: Composition, base: Path, error: ErrorDetails) -> Problem:
    kind, context = error["type"], error.get("ctx", {})
    inner = _existing(data, error["loc"])
    path = (*base, *inner)
    if kind == "missing":
        name = str(error["loc"][-1])
        parent = f" in {quoted(dotted(path))}" if path else ""
        return composition.problem(
            "missing-field",
            f"the field {quoted(name)} is missing{parent}",
            path,
            key=True,
            expected=_described(model, inner, name),
        )
    if kind == "extra_forbidden":
        name = str(inner[-1])
        known = _fields(model, inner[:-1])
        return composition.problem(
            "unknown-key",
            f"unknown key {quoted(name)}",
            path,
            key=True,
            expected=f"one of {', '.join(sorted(known))}" if known else "no key here",
            suggestion=nearest(name, known),
        )
    said = said_of(error["input"])
    if error["loc"] and error["loc"][-1] == "[key]":
        return composition.problem(
            "bad-name",
            f"{quoted(str(inner[-1]))} is not a name",
            path,
            key=True,
            expected="a letter or _, then letters, digits, _ or -; at most 64 in all",
        )
    if kind in _TYPES:
        return composition.problem("wrong-type", f"{_what(path)} is {said}", path, expected=_TYPES[kind])
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return composition.problem(
            "out-of-range", f"{_what(path)} is {said}", path, expected=f"a number {words} {context[key]}"
        )
    if kind in ("literal_error", "enum"):
        if path == ("symaware",):
            return composition.problem(
                "wrong-version",
                f"the scenario is written in format version {said}",
                path,
                expected="format version 1, the one this SymAware reads",
            )
        choices = _choices(str(context.get("expected", "")))
        return composition.problem(
            "wrong-value",
            f"{_what(path)} is {said}",
            path,
            expected=f"one of {', '.join(choices)}",
            suggestion=nearest(str(error["input"]), choices) if isinstance(error["input"], str) else None,
        )
    if kind == "string_pattern_mismatch":
        return composition.problem(
            "bad-name",
            f"{_what(path)} is {said}",
            path,
            expected="a letter or _, then letters, digits, _ or -; at most 64 in all",
        )
    message = error["msg"].removeprefix("Value error, ")
    return composition.problem("invalid-value", f"{_what(path)} is {said}: {message[:1].lower()}{message[1:]}", path)


def said_of(value: Any) -> str:
    """Describe what a file says in a few words."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return f"{value:g}" if isinstance(value, float) else str(value)
    if isinstance(value, str):
        return f"the text {quoted(value)}"
    if isinstance(value, Mapping):
        return "a mapping" if value else "an empty mapping"
    if isinstance(value, Sequence):
        return f"a list of {len(value)}"
    return type(value).__name__


def _what(path: Path) -> str:
    return quoted(dotted(path)) if path else "the document"


def _existing(data: Any, location: Sequence[str | int]) -> Path:
    """Leave out of a location what pydantic put in for itself, such as the branch of a union."""
    path: list[str | int] = []
    for part in location:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            continue
        path.append(part)
    return tuple(path)


def _choices(expected: str) -> list[str]:
    """Take apart pydantic's "'a', 'b' or 'c'"."""
    return [part.strip().strip("'") for part in expected.replace(" or ", ", ").split(",") if part.strip()]


def _fields(model: type[BaseModel], path: Path) -> list[str]:
    """The keys that are valid at a path, or none where that is not known."""
    owner = _model_at(model, path)
    if owner is None:
        return []
    return [field.alias or name for name, field in owner.model_fields.items()]


def _described(model: type[BaseModel], path: Path, name: str) -> str | None:
    owner = _model_at(model, path)
    for field_name, field in owner.model_fields.items() if owner else ():
        if name in (field.alias, field_name) and field.description:
            text = field.description.split(". ")[0].rstrip(".")
            return text[:1].lower() + text[1:]
    return None


def _model_at(model: type[BaseModel], path: Path) -> type[BaseModel] | None:
    """Follow a path from a model through fields, mappings and lists to the model that describes what is there."""
    annotation: Any = model
    for part in path:
        owner = _model_in(annotation)
        if owner is not None:
            fields = {field.alias or name: field for name, field in owner.model_fields.items()}
            if part not in fields:
                return None
            annotation = fields[str(part)].annotation
        else:
            arguments = [each for each in _branches(annotation) if typing.get_origin(each) in (dict, list, tuple)]
            if not arguments:
                return None
            annotation = [each for each in typing.get_args(arguments[0]) if each is not Ellipsis][-1]
    return _model_in(annotation)


def _branches(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) is typing.Annotated:
        return _branches(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return [inner for each in typing.get_args(annotation) for inner in _branches(each)]
    return [annotation]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    found = [each for each in _branches(annotation) if isinstance(each, type) and issubclass(each, BaseModel)]
    return found[0] if len(found) == 1 else None
