"""Fuzzes the size of numbers: every numeric field of scenarios and every window of a formula, far too large."""

from __future__ import annotations

import copy
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from random import Random
from typing import Any

from fuzzing.target import Finding, Target

Tree = dict[str, Any]

#: The number of steps of a run, whatever duration is declared.
_STEPS = 10

SIZES = (10**6, 10**9, 10**12)

_BASE: Tree = {
    "symaware": 1,
    "name": "numbers",
    "run": {"duration": 0.1},
    "environment": {"use": "kinematic", "with": {"time_step": 0.01}},
    "agents": {
        "robot": {
            "count": 2,
            "entity": {"shape": {"circle": {"radius": 0.2}}},
            "model": {"use": "unicycle"},
            "state": {"each": [[0, 0, 0], [3, 0, 0]]},
            "knowledge": {"goal": {"all": [5, 1]}, "waypoints": {"all": [[1, 1], [2, 0]]}},
            "components": {
                "sense": {"use": "perception.omniscient"},
                "steer": {"use": "control.go-to-goal"},
                "tell": {"use": "communication.broadcast"},
            },
        }
    },
    "regions": {"area": {"box": [0, 6, -3, 3]}},
    "specifications": {"near": {"each": "robot", "formula": "always x > -100"}},
}

FORMULAS = [
    *(
        f"{word}[{window}] x > 1"
        for word in ("always", "eventually", "historically", "once")
        for window in ("0, N", "N, N")
    ),
    *(f"x > -9 {word}[{window}] y > 1" for word in ("until", "since") for window in ("0, N", "N, N")),
    *("always[0, N] eventually[0, N] x > 1", "eventually[N, N] always[0, N] x > 1", "always (x > 1 until[0, N] y > 1)"),
    *("always x > N", "eventually x ** N > 1", "always x * N < N", "always time < N"),
]

_TEXTS = {
    "formula": "always x > -100",
    "region": "area",
    "of": "robot",
    "each": "robot",
    "agents": "robot",
    "agent": "robot.0",
    "target": "robot.0",
    "from": "robot.0",
    "to": "robot.1",
    "component": "steer",
    "event": "contact",
    "condition": "time > 0.02",
    "until": "time > 1",
    "when": "time > 0.02",
}


class Numbers(Target):
    """Each case is a scenario as JSON, with one number that is far too large."""

    time_limit = 120.0
    address_space = 4 << 30
    memory_limit = 500 << 20
    cases_per_worker = 2000

    @cached_property
    def _cases(self) -> list[Tree]:
        return [each for size in SIZES for each in cases(size)]

    def make(self, chance: Random) -> bytes:
        """Draw one of all cases."""
        return json.dumps(chance.choice(self._cases)).encode()

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Run it for ten steps, or see it refused at a place."""
        from symaware_cli.language import ScenarioError
        from symaware_cli.language.build import build
        from symaware_cli.language.execution import execute

        path = folder / "case.yaml"
        path.write_bytes(case)
        try:
            built = build(path)
        except ScenarioError as error:
            for problem in error.problems:
                if problem.span is None:
                    raise Finding("unlocated", f"{problem.code}: {problem.message}") from error
            return Counter(refused=1)
        summary = execute(replace(built, steps=min(built.steps, _STEPS)), folder / "run.mcap", timeout=60.0)
        if summary.status == "interrupted":
            raise Finding("hang", f"{_STEPS} steps took more than a minute", "steps")
        if summary.status == "failed" and "MemoryError" in (summary.traceback or summary.failure or ""):
            raise Finding("memory", f"{summary.failure}\n{summary.traceback}", str(summary.failure)[:80])
        return Counter({summary.status: 1})


def cases(size: int) -> Iterator[Tree]:
    """All scenarios with a number of that size: each numeric field, and each window of a formula."""
    yield from fields(size)
    for formula in FORMULAS:
        yield with_formula(formula, size)


def fields(size: int) -> Iterator[Tree]:
    """All scenarios with a number of that size in a numeric field; in the same order for each size."""
    from symaware_cli.language import scenario_schema

    yield from _Walk(scenario_schema(built_in_only=True)[0]).documents(size)


def with_formula(formula: str, size: int) -> Tree:
    """A scenario with a formula in which `N` stands for a number."""
    document = copy.deepcopy(_BASE)
    document["specifications"]["near"]["formula"] = formula.replace("N", str(size))
    return document


class _Walk:
    """All values of a JSON schema that contain a given number in one place, and else as little as possible."""

    def __init__(self, schema: Mapping[str, Any]) -> None:
        self._definitions: Mapping[str, Any] = schema["$defs"]

    def documents(self, number: int) -> Iterator[Tree]:
        """Scenarios that have the number in one place."""
        root = self._definitions["ScenarioDocument"]
        for name, inner in root["properties"].items():
            for value in self._with(inner, number, name, ()):
                document = copy.deepcopy(_BASE)
                document[name] = _joined(document.get(name), value)
                yield document

    def _with(self, schema: Mapping[str, Any], number: int, name: str, above: tuple[str, ...]) -> Iterator[Any]:
        if "$ref" in schema:
            definition = schema["$ref"].rpartition("/")[2]
            if definition not in above and definition in self._definitions:
                yield from self._with(self._definitions[definition], number, name, (*above, definition))
            return
        if "else" in schema:
            yield from self._with(schema["else"], number, name, above)
            return
        for branch in schema.get("allOf", ()):
            use = branch.get("if", {}).get("properties", {}).get("use", {}).get("const")
            if use is not None:
                for value in self._with(branch["then"]["properties"]["with"], number, "with", above):
                    yield {**self._least(schema, name), "use": use, "with": value}
        for branch in schema.get("anyOf", ()):
            yield from self._with(branch, number, name, above)
        if schema.get("type") in ("number", "integer"):
            yield number
        if "prefixItems" in schema:
            least = [self._least(each, name) for each in schema["prefixItems"]]
            for place, each in enumerate(schema["prefixItems"]):
                for value in self._with(each, number, name, above):
                    yield [*least[:place], value, *least[place + 1 :]]
        elif schema.get("type") == "array" and "items" in schema:
            for value in self._with(schema["items"], number, name, above):
                yield [value, *(self._least(schema["items"], name) for _ in range(schema.get("minItems", 1) - 1))]
        for key, inner in schema.get("properties", {}).items():
            for value in self._with(inner, number, key, above):
                yield {**self._least(schema, name), key: value}
        for inner in schema.get("patternProperties", {}).values():
            key = "robot" if name == "agents" else "steer" if name == "components" else "it"
            for value in self._with(inner, number, key, above):
                yield {key: value}

    def _least(self, schema: Mapping[str, Any], name: str) -> Any:
        """A small value that a schema allows."""
        if "$ref" in schema:
            return self._least(self._definitions.get(schema["$ref"].rpartition("/")[2], {}), name)
        if "const" in schema or "enum" in schema or "default" in schema:
            return schema.get("const", schema.get("default", schema.get("enum", [None])[0]))
        if "anyOf" in schema and "properties" not in schema:
            return self._least(schema["anyOf"][0], name)
        match schema.get("type"):
            case "number" | "integer":
                return max(schema.get("minimum", 1), schema.get("exclusiveMinimum", 0) + 1)
            case "boolean":
                return False
            case "string":
                return _TEXTS.get(name, next(iter(schema.get("examples", ())), "robot"))
            case "array":
                items = schema.get("prefixItems") or [schema.get("items", {})] * schema.get("minItems", 0)
                return [self._least(each, name) for each in items]
        return {key: self._least(schema["properties"][key], key) for key in schema.get("required", ())}


def _joined(one: Any, other: Any) -> Any:
    """Two values, where mappings are joined and the second counts otherwise."""
    if isinstance(one, dict) and isinstance(other, dict):
        if other.get("use", one.get("use")) != one.get("use"):
            return other
        return {**one, **{key: _joined(one.get(key), value) for key, value in other.items()}}
    return other


TARGET = Numbers()
