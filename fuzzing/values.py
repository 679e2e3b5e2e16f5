"""Draws values that the JSON schema of scenarios allows, and that are likely to be valid beyond it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from fuzzing.draft import Draft, Tree
from fuzzing.grammar import Grammar

#: Properties that are not drawn: a window needs a screen, and a scenario stands in one file here.
_LEFT_OUT = frozenset({"gui", "extends", "like", "plugins", "templates"})

_TIMES = frozenset({"at", "for", "open_for", "delay", "jitter", "period", "offset", "latency", "by", "from", "until"})

#: Numbers which depend on wall time, and ordinary values of theirs that change nothing.
_OF_THE_CLOCK: Mapping[str, Sequence[float]] = {
    "pace": (1e5, 1e6),
    "turn_limit": (60.0, 1000.0),
    "timeout": (5.0, 20.0),
    "hang_timeout": (60.0, 90.0),
}

#: Definitions of which exactly one property is chosen, besides some that go with any.
_ALTERNATIVES: Mapping[str, Sequence[str]] = {
    "Shape": (),
    "RegionShape": (),
    "Region": ("around", "turns", "colour"),
}

#: Lists with one number for each element of the state.
_OF_THE_STATE = {("Bias", "state"), ("Noise", "deviation"), ("Shove", "by"), ("Placement", "state")}


class Values:
    """Draws values for a draft."""

    def __init__(self, draft: Draft, grammar: Grammar) -> None:
        self._draft = draft
        self._grammar = grammar
        self._makers: Mapping[str, Callable[[], Any]] = {
            "ProbabilityDistribution": self.distribution,
            "Polygon": lambda: {"vertices": self._corners()},
            "ScriptedPath": self._path,
            "Obstacle": self._obstacle,
            "model:linear": self._linear,
            "topology:graph": self._graph,
        }

    def use(self, kind: str, name: str, count: int | None = None) -> Tree:
        """A plugin with the parameters that it requires, and sometimes further ones."""
        count = self._draft.chance.choice([0, 0, 1, 2]) if count is None else count
        options = self._of(f"{kind}:{name}", count)
        return {"use": name, "with": options} if options else {"use": name}

    def options(self, name: str, count: int, *, without: Sequence[str] = ()) -> Tree:
        """All required properties of a definition, and some of the others."""
        definition = self._draft.definitions[name]
        properties = definition.get("properties", {})
        if name == "ProbabilityDistribution":
            return {}  # all of it is made
        if name in _ALTERNATIVES:
            free = _ALTERNATIVES[name]
            chosen = [self._draft.chance.choice([each for each in properties if each not in free])]
            chosen += [each for each in free if self._draft.chance.random() < 0.3]
        else:
            required = [each for each in definition.get("required", ()) if each not in without]
            taken = (*required, *without)
            others = [each for each in properties if each not in taken and each not in _LEFT_OUT]
            chosen = [*required, *self._draft.chance.sample(others, min(count, len(others)))]
        return {each: self.value(properties[each], each, name) for each in chosen}

    def value(self, schema: Mapping[str, Any], name: str, owner: str, depth: int = 0) -> Any:
        """An ordinary value that a schema allows, for the key of that name of a definition."""
        chance = self._draft.chance
        if "$ref" in schema:
            return self._of(schema["$ref"].rpartition("/")[2])
        if "else" in schema:
            return self.value(schema["else"], name, owner, depth)
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            return chance.choice(schema["enum"])
        if "anyOf" in schema or "oneOf" in schema:
            ways = [
                way for way in schema.get("anyOf", schema.get("oneOf")) if "parameters" not in str(way.get("pattern"))
            ]
            ways = [way for way in ways if way.get("type") != "null"] or ways
            return self.value(chance.choice(ways), name, owner, depth + 1)
        match schema.get("type"):
            case "number" | "integer":
                return self._number(schema, name)
            case "boolean":
                return chance.random() < 0.5
            case "string":
                return self._text(name, owner)
            case "null":
                return None
            case "array":
                return self._array(schema, name, owner, depth)
        for inner in (*schema.get("patternProperties", {}).values(), schema.get("additionalProperties")):
            if isinstance(inner, Mapping):
                key = chance.choice(["goal", "it", "x"])
                return {key: self.value(inner, key, owner, depth + 1) if inner else [1.0, 2.0]}
        return {"goal": [1.0, 2.0]} if name == "knowledge" else {}

    def _of(self, name: str, count: int | None = None) -> Any:
        """A value of a definition."""
        chance, definition = self._draft.chance, self._draft.definitions[name]
        if name == "PerAgent":
            return [round(chance.uniform(-3, 3), 1) for _ in range(2)]
        if "use" in definition.get("properties", {}):
            use = chance.choice([each["const"] for each in definition["properties"]["use"]["anyOf"]])
            kinds = ("component", "topology", "model", "transport", "abstraction")
            kind = next(each for each in kinds if f"{each}:{use}" in self._draft.definitions)
            return {**self.use(kind, use), **self.options(name, 0, without=("use", "with"))}
        made = self._makers[name]() if name in self._makers else {}
        return {**self.options(name, chance.randint(0, 2) if count is None else count, without=tuple(made)), **made}

    def _text(self, name: str, owner: str) -> str:
        """A text for a key of a definition."""
        chance = self._draft.chance
        match name:
            case "formula":
                return self._grammar.formula("each", 2)
            case "condition":
                return self._grammar.condition("turn")
            case "until":
                return self._grammar.condition("world" if owner == "RunSection" else "turn")
            case "from":
                return self._grammar.condition("world")
        return chance.choice(self._draft.texts(name, owner))

    def _array(self, schema: Mapping[str, Any], name: str, owner: str, depth: int) -> list[Any]:
        if (owner, name) in _OF_THE_STATE:
            return [round(self._draft.chance.uniform(-0.5, 0.5), 2) for _ in range(self._draft.chance.choice([2, 3]))]
        if name == "polygon":
            return self._corners()
        if "prefixItems" in schema:
            drawn = [self.value(inner, name, owner, depth + 1) for inner in schema["prefixItems"]]
            return sorted(drawn) if all(isinstance(each, int | float) for each in drawn) else drawn
        least, most = schema.get("minItems", 0), schema.get("maxItems", 3)
        length = self._draft.chance.randint(least, max(least, min(most, 3)))
        if schema.get("items", {}).get("type") == "number" and schema.keys().isdisjoint({"minItems", "maxItems"}):
            length = self._draft.chance.choice([2, 2, 3])  # control inputs and states have no less
        if name == "box":
            bounds = sorted(round(self._draft.chance.uniform(-4, 4), 2) for _ in range(4))
            return [bounds[0], bounds[2], bounds[1], bounds[3]]
        return [self.value(schema.get("items", {}), name, owner, depth + 1) for _ in range(length)]

    def _number(self, schema: Mapping[str, Any], name: str) -> float | int:
        chance = self._draft.chance
        low: float = schema.get("minimum", schema.get("exclusiveMinimum", -math.inf))
        high: float = schema.get("maximum", schema.get("exclusiveMaximum", math.inf))
        if schema.get("type") == "integer":
            first = int(max(low, 0))
            return chance.randint(first, int(min(high, first + 5)))
        if name in _OF_THE_CLOCK:
            return chance.choice(_OF_THE_CLOCK[name])
        if name in _TIMES:
            step, duration = self._draft.step, self._draft.duration
            some = round(chance.uniform(0, duration), 4)
            return chance.choice([step, 2 * step, round(0.37 * step, 4), round(duration / 3, 4), some])
        # Around 0 where that is allowed, and otherwise near the limit that is next to it.
        least, most = max(low, -2.0), min(high, 2.0)
        if least > most:
            least, most = (low, low + 1.0) if low > 2.0 else (high - 1.0, high)
        drawn = round(chance.uniform(least, most), 2)
        return drawn if low < drawn < high else 0.5 * (least + most)

    # Values that hardly any draw would be

    def distribution(self) -> Tree:
        """A distribution of positive numbers, such as durations."""
        chance = self._draft.chance
        first, second = sorted(round(chance.uniform(0.001, 0.5), 3) for _ in range(2))
        form = chance.choice(["uniform", "normal", "lognormal", "loguniform", "exponential", "choice"])
        made: Tree = {form: first if form == "exponential" else [first, second]}
        if form == "choice":
            return made | ({"weights": [1.0, 2.0]} if chance.random() < 0.3 else {})
        made |= {"constant": round(chance.uniform(0, 0.1), 3)} if chance.random() < 0.3 else {}
        made |= {"least": 0.0} if form == "normal" else {}
        is_bounded = form in ("normal", "lognormal", "exponential") and chance.random() < 0.3
        return made | ({"greatest": first + second} if is_bounded else {})

    def _corners(self) -> list[list[float]]:
        """The corners of a convex polygon: points of a circle, in order."""
        chance = self._draft.chance
        radius, count = chance.uniform(0.2, 1.5), chance.randint(3, 6)
        angles = [2 * math.pi * (place + chance.uniform(0, 0.6)) / count for place in range(count)]
        return [[round(radius * math.cos(each), 3), round(radius * math.sin(each), 3)] for each in angles]

    def _path(self) -> Tree:
        chance = self._draft.chance
        count = chance.randint(2, 4)
        times = sorted(chance.sample(range(100), count))
        path: Tree = {"times": [round(0.01 * each * self._draft.duration, 4) for each in times]}
        path["positions"] = [[round(chance.uniform(-3, 3), 2) for _ in range(2)] for _ in range(count)]
        if chance.random() < 0.5:
            path["headings"] = [round(chance.uniform(-3, 3), 2) for _ in range(count)]
        return path

    def _obstacle(self) -> Tree:
        """A position, or a path; without a mass and a path, nothing moves it."""
        chance = self._draft.chance
        schema = self._draft.definitions["Obstacle"]["properties"]
        if chance.random() < 0.3:
            return {"path": self.value(schema["path"], "path", "Obstacle")}
        size = 3 if self._draft.tree["environment"]["use"] == "pybullet" and chance.random() < 0.5 else 2
        obstacle: Tree = {"position": [round(chance.uniform(-3, 3), 2) for _ in range(size)]}
        if chance.random() < 0.4 and self._draft.tree["environment"]["use"] != "kinematic":
            obstacle["mass"] = round(chance.uniform(0.1, 3), 2)
            motion = [each for each in ("velocity", "turn_rate") if chance.random() < 0.4]
            obstacle |= {each: self.value(schema[each], each, "Obstacle") for each in motion}
        return obstacle

    def _linear(self) -> Tree:
        chance, step = self._draft.chance, self._draft.step
        model: Tree = {"time_step": step, "state": {"x": "m", "y": "m"}, "control_input": {"u": "m/s", "v": "m/s"}}
        model |= {"A": [[1.0, 0.0], [0.0, chance.choice([1.0, 0.9])]], "B": [[step, 0.0], [0.0, step]]}
        if chance.random() < 0.5:
            model["W"] = [[0.01, 0.0], [0.0, 0.02]]
        return model

    def _graph(self) -> Tree:
        agents = self._draft.agents()
        edges = [self._draft.chance.sample(agents, 2) for _ in range(3)] if len(agents) > 1 else [["*", "*"]]
        return {"edges": [each for place, each in enumerate(edges) if each not in edges[:place]]}
