"""The vocabulary of the language: what scenarios can contain, by the JSON schema and the grammar of formulas.

A word is a property of a definition (`FaultUse.stop`, `component:control.mpc.horizon`), one of the values of a property
(`RunSection.mode=asynchronous`), the name of a plugin (`use:control.mpc`), an operator, function or name of formulas
(`formula:until`), or the name of an event (`event:contact`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

#: The keys under which a text is a formula or a condition.
_FORMULAS = frozenset({"formula", "condition", "until", "from", "where", "labels", "assumptions", "guarantees"})

#: Operators of formulas that are words.
_OPERATORS = (
    *("implies", "or", "and", "until", "since", "not", "always", "eventually", "next", "weak next", "historically"),
    "once",
)

#: Operators of formulas that are signs.
_SIGNS = ("<", "<=", ">", ">=", "==", "!=", "+", "-", "*", "/", "%", "**")

#: Names that mean something in formulas of some scope, besides the elements of states, regions and knowledge.
_NAMES = (
    *("state", "position", "velocity", "speed", "control_input", "nearest", "goal", "knowledge", "time", "risk"),
    *("uncertainty", "has_intent", "distance", "closing_speed", "goals_reached", "min_separation", "highest_risk"),
    *("contacts", "agents", "present", "violated", "satisfied", "robustness"),
)


def vocabulary(schema: Mapping[str, Any]) -> set[str]:
    """All words of the language.

    Args:
        schema: The JSON schema of scenarios, with the parameters of the plugins that count.
    """
    from symaware_cli.specification.columns import FUNCTIONS

    definitions = schema["$defs"]
    words = {f"formula:{word}" for word in (*_OPERATORS, *_SIGNS, *_NAMES, *FUNCTIONS)}
    words |= {f"event:{name}" for name in events(schema)}
    for name, definition in definitions.items():
        if name.startswith("partial:"):
            continue
        for way in (definition, *definition.get("anyOf", ())):
            for key, inner in way.get("properties", {}).items():
                words.add(f"{name}.{key}")
                words |= {f"{name}.{key}={value}" for value in _values(inner) if key != "use"}
        # The kinds of faults are keys.
        if name.count(":") == 1 and not name.startswith("fault:"):
            words.add(f"use:{name.partition(':')[2]}")
    return words


def events(schema: Mapping[str, Any]) -> list[str]:
    """The names of the events of runs, and of those that components declare."""
    from symaware_cli.core.event import RECURRING
    from symaware_cli.language import Catalogue

    ours = {"started", "finished", "contact", "overrun", "failed", "restarted", "terminated", "added", "removed"}
    ours |= {"fault", "fault-over", "violated", "satisfied", "offered", "accepted", "links-changed"}
    catalogue = Catalogue()
    components = [name.partition(":")[2] for name in schema["$defs"] if name.startswith("component:")]
    declared = {event for name in components if ":" not in name for event in catalogue.load("component", name).events}
    return sorted(ours | declared | RECURRING)


def words_of(tree: Any, schema: Mapping[str, Any]) -> set[str]:
    """The words that a scenario contains."""
    definitions = schema["$defs"]
    return set(_words(tree, "ScenarioDocument", definitions["ScenarioDocument"], definitions))


def _words(value: Any, name: str, schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Iterator[str]:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        yield from _words(value, name.removeprefix("partial:"), definitions[name], definitions)
        return
    if "else" in schema:
        is_alike = isinstance(value, dict) and "like" in value
        yield from _words(value, name, schema["then" if is_alike else "else"], definitions)
        return
    for way in (*schema.get("anyOf", ()), *schema.get("oneOf", ())):
        if _may_be(value, way, definitions):
            yield from _words(value, name, way, definitions)
    if isinstance(value, list):
        for each in value:
            yield from _words(each, name, schema.get("items", {}), definitions)
    if not isinstance(value, dict):
        return
    use = value.get("use") if "use" in schema.get("properties", {}) else None
    if isinstance(use, str):
        yield f"use:{use}"
    for key, inner in value.items():
        if key in schema.get("properties", {}):
            yield f"{name}.{key}"
            below = schema["properties"][key]
            if not isinstance(inner, dict | list):
                yield from (f"{name}.{key}={each}" for each in _values(below) if each == inner and key != "use")
            if key == "with" and isinstance(use, str):
                plugin = next((each for each in definitions if each.partition(":")[2] == use), "")
                yield from _words(inner, plugin, definitions.get(plugin, {}), definitions)
            else:
                yield from _words(inner, name, below, definitions)
        else:
            for other in (*schema.get("patternProperties", {}).values(), schema.get("additionalProperties")):
                yield from _words(inner, name, other, definitions) if isinstance(other, Mapping) else ()
        if key == "event" and isinstance(inner, str):
            yield f"event:{inner}"
        if key in _FORMULAS:
            yield from (f"formula:{word}" for text in _texts(inner) for word in formula_words(text))


def _values(schema: Mapping[str, Any]) -> list[Any]:
    """The values of a property that can be enumerated."""
    if "enum" in schema:
        return list(schema["enum"])
    if "const" in schema:
        return [schema["const"]]
    if schema.get("type") == "boolean":
        return [True, False]
    return [value for way in schema.get("anyOf", ()) for value in _values(way)]


def _may_be(value: Any, schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> bool:
    """Whether a value is of the type of a schema, and has the keys of its objects."""
    if "$ref" in schema:
        return _may_be(value, definitions[schema["$ref"].rpartition("/")[2]], definitions)
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        return bool(value.keys() <= properties.keys()) if properties else schema.get("type") == "object"
    if isinstance(value, list):
        return schema.get("type") == "array"
    return schema.get("type") not in ("object", "array") and "properties" not in schema


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _texts(each)


def formula_words(text: str) -> set[str]:
    """The operators, functions and names of a formula or condition."""
    return set(re.findall(r"weak next|[A-Za-z_]\w*|\*\*|<=|>=|==|!=|[-+*/%<>]", re.sub(r'"[^"]*"', "", text)))
