"""Validates data against pydantic models, and translates each error into a problem with its position.

`build` validates the document, and `plugin_factory` the parameters of each plugin.
"""

from __future__ import annotations

import difflib
import json
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import BaseModel, RootModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from symaware_cli.language.compose import Composition
from symaware_cli.language.problem import Problem, dotted, is_inside, nearest, quoted
from symaware_cli.language.section import IDENTIFIER
from symaware_cli.language.source import Path

AnyModel = TypeVar("AnyModel", bound=BaseModel)

_NUMBERS = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number",
    "int_from_float": "a whole number",
}
_TYPES = {
    **_NUMBERS,
    "bool_type": "true or false",
    "bool_parsing": "true or false",
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
    "greater_than_equal": ("ge", "of at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "of at most"),
}
_NUMERAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_FLAGS = {"true": "true", "yes": "true", "on": "true", "false": "false", "no": "false", "off": "false"}
_NAME_RULE = "a letter or _, then letters, digits, _ or -; at most 64 in all"


def validate(
    model: type[AnyModel], data: Any, composition: Composition, path: Path, others: Sequence[Path] = ()
) -> AnyModel | list[Problem]:
    """Validate the data at a path of a document.

    Types are not converted: texts are not accepted as numbers, nor numbers as flags.

    Args:
        model: The model to validate against.
        data: Plain data.
        composition: The document, which has the positions.
        path: The path of the data.
        others: Paths that are valid elsewhere in the document, to recognise misplaced keys.

    Returns:
        The validated model, or every problem with the data.
    """
    try:
        return model.model_validate_json(json.dumps(data), strict=True)
    except ValidationError as error:
        details = error.errors(include_url=False)
    translator = _ErrorTranslator(model, data, composition, path, others)
    problems = [translator.problem(each) for each in details if not _is_consequence(each)]
    return _deduplicated(problem for problem in problems if translator.missing.get(problem) not in translator.meant)


def _is_consequence(error: ErrorDetails) -> bool:
    """Whether a list is only too short because invalid elements, which are reported separately, were not counted."""
    return error["type"] == "too_short" and len(error["input"]) >= error["ctx"]["min_length"]


def _deduplicated(problems: Iterable[Problem]) -> list[Problem]:
    """Combine the errors that pydantic reports for each branch of a union."""
    first: dict[tuple[str, str], Problem] = {}
    for problem in problems:
        # Several fields can be missing at one path.
        key = (problem.path, problem.message if problem.code == "missing-field" else "")
        known = first.get(key)
        if known is None:
            first[key] = problem
        elif known.code == problem.code == "wrong-type" and problem.expected not in (None, known.expected):
            ways = [str(known.expected), str(problem.expected)]
            # What is said of quotes is about numbers only.
            if ways[0].endswith("quotes"):
                ways.reverse()
            first[key] = replace(known, expected=" or ".join(ways))
        elif known.code == "wrong-type" and problem.code in ("invalid-value", "wrong-length"):
            # The branch of the right type has the more specific problem.
            first[key] = problem
    # If an element of a list is invalid, the type error of another branch for the whole list is dropped.
    inside = [problem.path for problem in first.values()]
    return [
        problem
        for problem in first.values()
        if problem.code != "wrong-type"
        or not any(path != problem.path and is_inside(path, problem.path) for path in inside)
    ]


class _ErrorTranslator:
    """Translates pydantic's errors for one piece of data into problems.

    Attributes:
        missing: The path of the missing field, by problem.
        meant: The fields that unknown keys were probably meant to be; these are not reported as missing.
    """

    def __init__(
        self, model: type[BaseModel], data: Any, composition: Composition, base: Path, others: Sequence[Path]
    ) -> None:
        self._model = model
        self._data = data
        self._composition = composition
        self._base = base
        self._others = others
        self.missing: dict[Problem, Path] = {}
        self.meant: set[Path | None] = set()

    def problem(self, error: ErrorDetails) -> Problem:
        kind, context, value = error["type"], error.get("ctx", {}), error["input"]
        inner = _existing(self._data, error["loc"])
        path = (*self._base, *inner)
        said = f"{_what(path)} is {said_of(value)}"
        if kind == "missing" and isinstance(error["loc"][-1], int):
            return self._composition.problem("wrong-length", said, path, expected=self._expected_length(inner))
        if kind == "missing":
            return self._missing(inner, str(error["loc"][-1]))
        if kind == "extra_forbidden":
            return self._unknown(inner)
        if error["loc"] and error["loc"][-1] == "[key]":
            name = quoted(str(inner[-1]))
            if context.get("pattern") == IDENTIFIER:
                minus = ", in which - is a minus" if "-" in str(inner[-1]) else ""
                said = f"{name} is not a name for expressions{minus}"
                plain = str(inner[-1]).replace("-", "_")
                other = plain if re.match(IDENTIFIER, plain) else None
                rule = "a letter or _, then letters, digits or _; at most 64 in all"
                return self._composition.problem("bad-name", said, path, key=True, expected=rule, suggestion=other)
            return self._composition.problem("bad-name", f"{name} is not a name", path, key=True, expected=_NAME_RULE)
        if kind in _TYPES:
            expected, suggestion = self._type(kind, inner, value)
            return self._composition.problem("wrong-type", said, path, expected=expected, suggestion=suggestion)
        if kind in _BOUNDS:
            key, words = _BOUNDS[kind]
            noun = "a whole number" if _is_whole(value) and _is_whole(context[key]) else "a number"
            expected = f"{noun} {words} {_bound(context[key])}{self._unit(inner)}"
            return self._composition.problem("out-of-range", said, path, expected=expected)
        if kind in ("too_short", "too_long"):
            return self._length(inner, value, context)
        if kind in ("literal_error", "enum"):
            return self._choice(path, value, str(context.get("expected", "")))
        if kind == "string_pattern_mismatch" and context.get("pattern", "").startswith("^[A-Za-z_]"):
            return self._composition.problem("bad-name", said, path, expected=_NAME_RULE)
        message = error["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
        message = f"{message[:1].lower()}{message[1:]}"
        given = value if isinstance(value, Mapping) else {}
        culprit = (*path, *_mentioned(message, given))
        subject = said if culprit == path and not isinstance(value, Mapping | list) else _what(culprit)
        # A problem with a whole mapping is shown at its key, because the mapping itself starts with its first entry.
        return self._composition.problem(
            "invalid-value", f"{subject}: {message}", culprit, key=culprit == path and bool(given)
        )

    def _missing(self, inner: Path, name: str) -> Problem:
        path = (*self._base, *inner)
        parent = f" in {_what(path)}" if path else ""
        field = _fields(_model_at(self._model, inner)).get(name)
        expected = None
        if field is not None and field.description:
            text = re.split(r"\. |; ", field.description)[0].rstrip(".")
            expected = text[:1].lower() + text[1:]
            choices = typing.get_args(field.annotation) if typing.get_origin(field.annotation) is typing.Literal else ()
            if len(choices) == 1:
                expected = f"`{choices[0]}`, the {expected}"
        message = f"the field {quoted(name)} is missing{parent}"
        problem = self._composition.problem("missing-field", message, path, key=True, expected=expected)
        self.missing[problem] = (*path, name)
        return problem

    def _unknown(self, inner: Path) -> Problem:
        path, name = (*self._base, *inner), str(inner[-1])
        owners = _models_in(_annotation_at(self._model, inner[:-1]))
        # Of a union, another branch may have it.
        known = sorted({each for owner in owners for each in _fields(owner)} - {name})
        suggestion = nearest(name, known)
        home = self._valid_path(path, name)
        # A name that is valid elsewhere takes precedence over a slightly similar one.
        alike = difflib.SequenceMatcher(None, name, suggestion).ratio() if suggestion else 0.0
        if home is not None and (alike < 0.8 or home[:-1] == (*path[:-1], "with")):
            expected = f"it under {quoted(dotted(home[:-1]))}" if home[:-1] else "it at the top level"
            meant, suggestion = home, None
        else:
            expected = f"one of {', '.join(known)}" if len(known) > 1 else quoted(known[0]) if known else "no key here"
            meant = (*path[:-1], suggestion or name)
        self.meant.add(meant)
        message = f"unknown key {quoted(name)}"
        return self._composition.problem(
            "unknown-key", message, path, key=True, expected=expected, suggestion=suggestion
        )

    def _valid_path(self, path: Path, name: str) -> Path | None:
        """Return another path at which a key with the name is valid, the one with the longest common prefix."""
        valid = [other for other in self._others if other[-1] == name]
        if not self._base:
            valid += [home for pattern in _field_paths(self._model) if (home := _filled_in(pattern, path, name))]
        # A deeply nested key, such as the `name` of a group, was hardly meant for the top level.
        valid = [home for home in valid if len(home) > 1 or len(path) <= 2]
        return max(valid, key=lambda home: _shared(home, path), default=None)

    def _type(self, kind: str, inner: Path, value: Any) -> tuple[str, str | None]:
        """Return the expected type for a value of the wrong type, and the value that was probably meant."""
        expected = _TYPES[kind]
        annotation = _annotation_at(self._model, inner)
        owner = _model_in(annotation)
        if kind in _NUMBERS:
            expected = a_number(value, expected + self._unit(inner))
        elif expected == "true or false" and isinstance(value, str):
            meant = _FLAGS.get(value.strip().lower())
            return (expected + ", without quotes", None) if value in ("true", "false") else (expected, meant)
        elif expected == "text" and isinstance(value, bool | int | float):
            expected += ", in quotes"
        elif owner is not None:
            required = [quoted(key) for key, field in _fields(owner).items() if field.is_required()]
            if required == ["`use`"] and isinstance(value, str):
                expected += f" such as {{use: {value}}}"
            elif required:
                expected += f" with {' and '.join(required)}"
        elif expected == "a mapping" and isinstance(value, list) and _element(annotation) is not None:
            expected += " that gives each a name"
        elif expected == "a list":
            expected = self._expected_length(inner) or expected
        return expected, None

    def _length(self, inner: Path, value: Any, context: Mapping[str, Any]) -> Problem:
        path = (*self._base, *inner)
        if isinstance(value, Mapping):
            return self._composition.problem("out-of-range", f"{_what(path)} is empty", path, expected="at least one")
        least, most = context.get("min_length"), context.get("max_length")
        bound = f"at least {least}" if most is None else f"at most {most}"
        said = f"{_what(path)} is {said_of(value)}"
        expected = self._expected_length(inner) or f"a list of {bound}"
        return self._composition.problem("wrong-length", said, path, expected=expected)

    def _expected_length(self, inner: Path) -> str | None:
        """Describe the expected list of fixed length: as the description of its field begins, or by its length."""
        lists = [each for each in _branches(_annotation_at(self._model, inner)) if typing.get_origin(each) is tuple]
        if not lists or Ellipsis in typing.get_args(lists[0]):
            return None
        field = _fields(_model_at(self._model, inner[:-1])).get(str(inner[-1])) if inner else None
        found = re.match(r"\[[^\]]*,[^\]]*\]", field.description or "") if field else None
        return found.group() if found else f"a list of {len(typing.get_args(lists[0]))}"

    def _choice(self, path: Path, value: Any, expected: str) -> Problem:
        written = [part.strip() for part in expected.replace(" or ", ", ").split(",") if part.strip()]
        choices = [part.strip("'") for part in written]
        # pydantic quotes texts, but not numbers.
        if isinstance(value, str) and value in written:
            return self._composition.problem(
                "wrong-type", f"{_what(path)} is {said_of(value)}", path, expected=f"{quoted(value)}, without quotes"
            )
        if path == ("symaware",) and _is_whole(value):
            return self._composition.problem(
                "wrong-version",
                f"the scenario is written in version {value} of the format",
                path,
                expected="version 1, the one that this SymAware reads",
            )
        return self._composition.problem(
            "wrong-value",
            f"{_what(path)} is {said_of(value)}",
            path,
            expected=f"one of {', '.join(choices)}" if len(choices) > 1 else quoted("".join(choices)),
            suggestion=nearest(value, choices) if isinstance(value, str) and len(choices) > 1 else None,
        )

    def _unit(self, inner: Path) -> str:
        """Return the unit that the description of a field states, as `` [m]``."""
        field = None
        for length in range(len(inner), 0, -1):
            # An element of a list has the unit of the list.
            if isinstance(inner[length - 1], str):
                field = _fields(_model_at(self._model, inner[: length - 1])).get(str(inner[length - 1]))
                break
        found = re.search(r"\[[^\[\],]+\]", field.description or "") if field else None
        return f" {found.group()}" if found else ""


def said_of(value: Any) -> str:
    """Describe a value in a few words."""
    if value is None:
        return "empty (null)"
    if isinstance(value, bool | int | float):
        return _number(value)
    if isinstance(value, str):
        return f"the text {quoted(value)}" if value else "an empty text"
    if isinstance(value, Mapping):
        return "a mapping" if value else "an empty mapping"
    if isinstance(value, Sequence):
        return f"a list of {len(value)}" if value else "an empty list"
    return type(value).__name__


def a_number(value: Any, expected: str = "a number") -> str:
    """Describe an expected number; if the value is a number in quotes, say to omit the quotes."""
    is_quoted = isinstance(value, str) and _NUMERAL.fullmatch(value.strip())
    return f"{expected}, without quotes" if is_quoted else expected


def _number(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return f"{value:.1f}"
    return str(value)


def _bound(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _what(path: Path) -> str:
    return quoted(dotted(path)) if path else "the document"


def _mentioned(message: str, names: Iterable[Any]) -> Path:
    """Return the only name that a validator's message mentions, as the position to report."""
    found = [name for name in names if isinstance(name, str) and re.search(rf"\b{re.escape(name)}\b", message)]
    return (found[0],) if len(found) == 1 and len(found[0]) > 2 else ()


def _existing(data: Any, location: Sequence[str | int]) -> Path:
    """Remove the parts of a location that are not in the data, such as branches of unions."""
    path: list[str | int] = []
    for part in location:
        if isinstance(data, Mapping) if isinstance(part, str) else isinstance(data, list):
            try:
                data = data[part]
            except (KeyError, IndexError):
                continue
            path.append(part)
    return tuple(path)


def _fields(model: type[BaseModel] | None) -> dict[str, FieldInfo]:
    """Return the fields of a model by their keys in a file; empty without a model."""
    return {field.alias or name: field for name, field in model.model_fields.items()} if model else {}


def _model_at(model: type[BaseModel], path: Path) -> type[BaseModel] | None:
    """Return the model of the value at a path, if there is one."""
    return _model_in(_annotation_at(model, path))


def _annotation_at(model: type[BaseModel], path: Path) -> Any:
    """Return the type annotation at a path, through fields, mappings and lists."""
    annotation: Any = model
    for part in path:
        owner = _model_in(annotation)
        if owner is not None:
            field = _fields(owner).get(str(part))
            annotation = field.annotation if field else None
        else:
            arguments = [each for each in _branches(annotation) if typing.get_origin(each) in (dict, list, tuple)]
            if not arguments:
                return None
            annotation = [each for each in typing.get_args(arguments[0]) if each is not Ellipsis][-1]
    return annotation


def _branches(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) is typing.Annotated:
        return _branches(typing.get_args(annotation)[0])
    if typing.get_origin(annotation) in (typing.Union, types.UnionType):
        return [inner for each in typing.get_args(annotation) for inner in _branches(each)]
    if isinstance(annotation, type) and issubclass(annotation, RootModel):
        return _branches(annotation.model_fields["root"].annotation)
    return [annotation]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    found = _models_in(annotation)
    return found[0] if len(found) == 1 else None


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    return [each for each in _branches(annotation) if isinstance(each, type) and issubclass(each, BaseModel)]


def _element(annotation: Any) -> type[BaseModel] | None:
    """Return the model of the values of a mapping, if they have one."""
    arguments = typing.get_args(annotation) if typing.get_origin(annotation) is dict else ()
    return _model_in(arguments[1]) if arguments else None


def _field_paths(model: type[BaseModel], prefix: tuple[str | None, ...] = ()) -> Iterator[tuple[str | None, ...]]:
    """Yield the path of every field of a document, with None for names chosen by the author."""
    for name, field in _fields(model).items():
        path = (*prefix, name)
        yield path
        for each in _branches(field.annotation):
            arguments = typing.get_args(each) if typing.get_origin(each) is dict else ()
            inner = _element(each) if arguments else _model_in(each)
            if inner is not None and len(path) < 10:
                yield from _field_paths(inner, (*path, None) if arguments else path)


def _filled_in(pattern: tuple[str | None, ...], path: Path, name: str) -> Path | None:
    """Fill in the open names of a pattern from a path with the same prefix; None if there is none."""
    if pattern[-1] != name:
        return None
    home: list[str | int] = []
    for depth, part in enumerate(pattern):
        if part is None and (depth >= len(path) - 1 or tuple(home) != path[:depth]):
            return None
        home.append(path[depth] if part is None else part)
    return tuple(home)


def _shared(one: Path, other: Path) -> int:
    return next((depth for depth, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), len(one))
