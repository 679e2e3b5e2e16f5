"""Fuzzes scenario files: damaged, restructured, or generated from the schema; valid ones are run for three steps."""

from __future__ import annotations

import copy
import json
import math
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

from fuzzing.target import Finding, Target

#: The first line of a case in TOML; the others are YAML.
_TOML = b"# toml\n"

#: The greatest number of steps of a run.
_STEPS = 3

_WORDS = [
    *(
        b"-1",
        b"0",
        b"1e308",
        b"-1e308",
        b"1e-320",
        b"nan",
        b".nan",
        b"inf",
        b".inf",
        b"null",
        b"~",
        b"true",
        b"[]",
        b"{}",
    ),
    *(
        b"&a",
        b"*a",
        b"<<: *a",
        b"!!python/object:os.system",
        b"!!binary",
        b"${parameters.x}",
        b"${",
        b"'",
        b'"',
        b"|",
        b">",
    ),
    *(
        b"---",
        b"...",
        b"#",
        b"%",
        b"\t",
        b"\r\n",
        b"\x00",
        b"\xff",
        b"\xe2\x80\xa8",
        b"9" * 40,
        b"0x7f",
        b"0o17",
        b"1_0",
    ),
    *(b"extends: ", b"use: ", b"with: ", b"count: 0", b"count: 100000", b"{uniform: [1, 0]}", b"{normal: [0, -1]}"),
]

_VALUES: list[Any] = [
    *(None, True, False, 0, 1, -1, 2, 7, 0.5, -0.25, 1e-9, 1e9, 1e-320, 1e308, -1e308, 2**31, 2**63, 10**30),
    *("", "x", "robot", "robot.0", "robot.*", "*", "position[0] > 1", "time < 1", "3", "a.b", "\u2028", "é" * 70),
    *([], [0], [0, 0], [0, 0, 0], [[0, 0], [1, 1]], [1e308, 1e308], {}, {"x": 1}, {"uniform": [0, 1]}),
    *({"normal": [0, 1]}, {"all": [1, 2]}, {"circle": {"radius": 2.0}}, {"grid": {"spacing": [1, 1]}}),
]

Tree = dict[str, Any]


class Scenarios(Target):
    """Each case is a scenario file."""

    time_limit = 180.0  # to make a solver for an involved model takes many seconds

    def prepare(self, folder: Path) -> None:
        """Read the scenarios that ship, and the schema with the parameters of all plugins."""
        import yaml

        from symaware_cli.language import scenario_schema

        root = Path(__file__).parents[2]
        places = [root / "scenarios", *sorted((root / "plugins").glob("*/scenarios"))]
        self._beside = {path.name: path.read_bytes() for place in places for path in place.iterdir() if path.is_file()}
        self._files = [path.read_bytes() for place in places for path in sorted(place.glob("*.yaml"))]
        self._toml = [_TOML + path.read_bytes() for place in places for path in sorted(place.glob("*.toml"))]
        self._trees: list[Tree] = [yaml.safe_load(content) for content in self._files]
        self._schema = Schema(scenario_schema()[0])
        self._draft = folder / "draft.yaml"
        self._lay_out(folder)

    def make(self, chance: Random) -> bytes:
        """Make a file in one of three ways."""
        way = chance.random()
        if way < 0.3:
            return _damaged(chance.choice(self._files + self._toml), chance)
        if way < 0.6:
            tree = _twisted(copy.deepcopy(chance.choice(self._trees)), self._trees, chance)
        else:
            tree = self._schema.scenario(chance)
        if chance.random() < 0.6:
            self._mend(tree)
        return _written(tree)

    def _mend(self, tree: Tree) -> None:
        """Remove rejected values, so that the rest is more likely to run."""
        from symaware_cli.language import ScenarioError
        from symaware_cli.language.build import build

        for _ in range(3):
            self._draft.write_bytes(_written(tree))
            try:
                build(self._draft)
            except ScenarioError as error:
                for path in sorted({problem.path for problem in error.problems if problem.path}, reverse=True):
                    _leave_out(tree, path)
            except Exception:
                return  # `attempt` will report the exception
            else:
                return

    def _lay_out(self, folder: Path) -> None:
        """Write the files that scenarios may extend."""
        for name, content in self._beside.items():
            (folder / name).write_bytes(content)

    def attempt(self, case: bytes, folder: Path) -> Counter[str]:
        """Validate the file as `symaware validate` does, and run it for three steps if it is valid."""
        self._lay_out(folder)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            became = self._try(case, folder)
        for warning in caught:
            place = f"{Path(warning.filename).name}:{warning.lineno}"
            raise Finding("warning", f"{warning.message} at {warning.filename}:{warning.lineno}", place)
        return became

    def _try(self, case: bytes, folder: Path) -> Counter[str]:
        from symaware_cli.language import ScenarioError, render
        from symaware_cli.language.build import build
        from symaware_cli.language.execution import execute
        from symaware_cli.log import open_log

        path = folder / ("case.toml" if case.startswith(_TOML) else "case.yaml")
        path.write_bytes(case)
        try:
            built = build(path)
        except ScenarioError as error:
            for problem in error.problems:
                if problem.span is None or problem.span.line < 1 or not problem.message.strip():
                    raise Finding("unlocated", f"{problem.code}: {problem.message}") from error
            render(error.problems)
            return Counter(refused=1)
        log = folder / "run.mcap" if len(case) % 3 == 0 else None
        summary = execute(replace(built, steps=min(built.steps, _STEPS)), log, timeout=self.time_limit / 2)
        if log:
            read = open_log(log)
            if read.damage or read.outcome is None:
                raise Finding("unreadable", f"a log of a run that {summary.status} is incomplete")
        if summary.status == "interrupted":
            raise Finding("hang", f"{_STEPS} steps took more than {self.time_limit / 2:g} s", "steps")
        failure = summary.failure or ""
        if summary.status == "failed" and (failure.startswith(("run:", "run ")) or "symaware, run" in failure):
            raise Finding("blame", f"the run itself is blamed: {failure}", failure[:60])
        return Counter({summary.status: 1})


def _damaged(content: bytes, chance: Random) -> bytes:
    """Change some bytes: replace, remove or repeat them, or insert keywords."""
    data = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 3, 8])):
        if not data:
            break
        place, length = chance.randrange(len(data)), chance.choice([1, 1, 2, 5, 20, 100])
        match chance.randrange(5):
            case 0:
                data[place] ^= 1 << chance.randrange(8)
            case 1:
                del data[place : place + length]
            case 2:
                data[place:place] = data[place : place + length] * chance.choice([1, 2, 50])
            case 3:
                data[place:place] = chance.choice(_WORDS)
            case _:
                data[place : place + length] = chance.choice(_WORDS)
    return bytes(data)


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """All containers of a tree, each with all its keys or indices."""
    if isinstance(tree, (dict, list)):
        for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
            yield tree, key
            yield from _places(tree[key])


def _twisted(tree: Tree, others: list[Tree], chance: Random) -> Tree:
    """Change the structure: other values, keys and branches, also from other scenarios."""
    for _ in range(chance.choice([1, 1, 2, 3, 6])):
        places = list(_places(tree))
        if not places:
            break
        holder, key = chance.choice(places)
        match chance.randrange(6):
            case 0 | 1:
                holder[key] = copy.deepcopy(chance.choice(_VALUES))
            case 2:
                del holder[key]
            case 3:
                there, place = chance.choice(list(_places(chance.choice(others))))
                holder[key] = copy.deepcopy(there[place])
            case 4 if isinstance(holder, dict):
                holder[chance.choice(["x", "use", "with", "count", "é", "", "1", "a b", "on_failure"])] = holder.pop(
                    key
                )
            case _ if isinstance(holder[key], (int, float)) and not isinstance(holder[key], bool):
                holder[key] = holder[key] * chance.choice([-1, 0, 1e-6, 0.5, 2, 1e6, 1e300])
            case _:
                holder[key] = [copy.deepcopy(holder[key]) for _ in range(chance.choice([1, 2, 3]))]
    return tree


def _leave_out(tree: Any, path: str) -> None:
    """Remove the innermost existing part of a dotted path."""
    holder, found = tree, None
    for part in re.findall(r"[^.\[\]]+", path):
        key = int(part) if isinstance(holder, list) and part.isdigit() else part
        try:
            inner = holder[key]
        except (KeyError, IndexError, TypeError):
            break
        found, holder = (holder, key), inner
    if found is not None and found[0] is not tree:
        del found[0][found[1]]


def _written(tree: Tree) -> bytes:
    """A tree as JSON, which is valid YAML except for NaN and infinities."""
    return json.dumps(tree, ensure_ascii=False, indent=1).replace("NaN", ".nan").replace("Infinity", ".inf").encode()


class Schema:
    """Generates values that a JSON schema allows, most of them ordinary, some extreme."""

    def __init__(self, schema: Mapping[str, Any]) -> None:
        self._definitions: Mapping[str, Any] = schema["$defs"]

    def scenario(self, chance: Random) -> Tree:
        """A small scenario, with the parameters of plugins drawn from their schemas."""
        step = chance.choice([0.01, 0.05, 0.1, 1.0])
        world = chance.choice(["kinematic", "kinematic", "pymunk", "pybullet"])
        scenario: Tree = {
            "symaware": 1,
            "name": "made",
            "seed": chance.randrange(9),
            "run": {"duration": 3 * step, "mode": chance.choice(["synchronous", "asynchronous"])},
            "environment": {
                "use": world,
                "with": {**self._some(f"environment:{world}", chance, 0.1), "time_step": step},
            },
            "agents": {name: self._group(chance) for name in ("robot", "other")[: chance.randint(1, 2)]},
        }
        if chance.random() < 0.3:
            obstacle = self.value(self._definitions["Obstacle"], chance)
            scenario["environment"]["entities"] = {"thing": obstacle}
        if chance.random() < 0.5:
            scenario["topology"] = self._plugin("topology", chance)
            if chance.random() < 0.5:
                scenario["topology"]["channel"] = self._some("ChannelParameters", chance, 0.3)
        if chance.random() < 0.3:
            fault = self.value(self._definitions["FaultUse"], chance)
            scenario["faults"] = {"trouble": fault} if isinstance(fault, dict) else fault
        return scenario

    def _group(self, chance: Random) -> Tree:
        components = {"sense": self._plugin("component:perception", chance, timing=False)}
        for number in range(chance.randint(0, 4)):
            components[f"c{number}"] = self._plugin("component", chance, timing=chance.random() < 0.3)
        there = {"waypoint": {"all": [3, 1]}, "target": {"all": [5, 5]}}
        goals = {
            **there,
            "goal": {"all": [3, 1]},
            "waypoints": {"all": [[1, 1], [2, 0]]},
            "velocity": {"all": [0.1, 0.1, 0.1]},
        }
        group: Tree = {
            "count": chance.choice([1, 2, 3, 5]),
            "model": self._plugin("model", chance),
            "components": components,
            "knowledge": {**goals, "offset": {"all": [-1, 0]}, "value": 1.0, "rumour": "x"},
        }
        if chance.random() < 0.5:
            group["entity"] = self._some("Entity", chance, 0.2)
        return group

    def _plugin(self, family: str, chance: Random, timing: bool = False) -> Tree:
        names = [name for name in self._definitions if name.startswith(family) and name.count(":") == 1]
        name = chance.choice(names)
        use: Tree = {"use": name.partition(":")[2], "with": self._some(name, chance, 0.3)}
        if timing:
            kind = self._some("ComponentUse", chance, 0.15)
            use = {**{key: value for key, value in kind.items() if key not in ("use", "with")}, **use}
        return use

    def _some(self, definition: str, chance: Random, share: float) -> Tree:
        """An object with all required properties and a share of the optional ones."""
        schema = self._definitions[definition]
        required = set(schema.get("required", ()))
        return {
            name: self.value(inner, chance)
            for name, inner in schema.get("properties", {}).items()
            if name in required or chance.random() < share
        }

    def value(self, schema: Mapping[str, Any], chance: Random, depth: int = 0) -> Any:
        """A value that a schema allows, or almost allows."""
        if chance.random() < 0.01:
            return copy.deepcopy(chance.choice(_VALUES))
        if "$ref" in schema:
            name = schema["$ref"].rpartition("/")[2].replace("~1", "/")
            if name not in self._definitions or depth > 8:
                return copy.deepcopy(chance.choice(_VALUES))
            return self.value(self._definitions[name], chance, depth + 1)
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            return chance.choice(schema["enum"])
        if "anyOf" in schema:
            ways = [way for way in schema["anyOf"] if "parameters" not in str(way.get("pattern"))]
            return self.value(chance.choice(ways or schema["anyOf"]), chance, depth + 1)
        kind = schema.get("type")
        if kind in ("number", "integer"):
            return _number(schema, chance, kind == "integer")
        if kind == "boolean":
            return chance.random() < 0.5
        if kind == "string":
            return chance.choice(
                ["x", "robot", "robot.0", "goal", "time > 0.1", "m", *map(str, schema.get("examples", ()))]
            )
        if kind == "null":
            return None
        if kind == "array":
            return self._array(schema, chance, depth)
        if kind == "object" or "properties" in schema:
            return self._object(schema, chance, depth)
        return copy.deepcopy(chance.choice(_VALUES))

    def _array(self, schema: Mapping[str, Any], chance: Random, depth: int) -> list[Any]:
        if "prefixItems" in schema:
            return [self.value(inner, chance, depth + 1) for inner in schema["prefixItems"]]
        least = schema.get("minItems", 0)
        length = chance.randint(least, max(least, min(schema.get("maxItems", 4), 4)))
        return [self.value(schema.get("items", {}), chance, depth + 1) for _ in range(length)]

    def _object(self, schema: Mapping[str, Any], chance: Random, depth: int) -> Tree:
        required = set(schema.get("required", ()))
        made = {
            name: self.value(inner, chance, depth + 1)
            for name, inner in schema.get("properties", {}).items()
            if name in required or (depth < 6 and chance.random() < 0.25)
        }
        if schema.get("title") == "Shape":  # of which a body has one
            made = {name: made[name] for name in list(made)[:1]}
        if not made and schema.get("properties"):
            name = chance.choice(list(schema["properties"]))
            made[name] = self.value(schema["properties"][name], chance, depth + 1)
        more = schema.get("additionalProperties")
        if isinstance(more, Mapping) and chance.random() < 0.7:
            made[chance.choice(["x", "goal", "robot", "robot.0"])] = self.value(more, chance, depth + 1)
        return made


def _number(schema: Mapping[str, Any], chance: Random, whole: bool) -> float | int:
    low = schema.get("minimum", schema.get("exclusiveMinimum", -math.inf))
    high = schema.get("maximum", schema.get("exclusiveMaximum", math.inf))
    if chance.random() < 0.1:
        edges = [each for each in (low, high) if math.isfinite(each)]
        edge = chance.choice([*edges, *edges, *edges, 0, 1e-12, 1e6, 1e12, 1e300, -1e300, 10**20, 5e-324])
        return int(edge) if whole else edge
    a, b = max(low, -5.0), min(high, 5.0)
    if a > b:
        a, b = low if math.isfinite(low) else high, high if math.isfinite(high) else low
    drawn = chance.uniform(a, b)
    return int(drawn) if whole else round(drawn, chance.choice([0, 1, 3]))


TARGET = Scenarios()
