"""Composes whole scenarios from the language: features are added one by one, and kept where the scenario stays valid.

What there is to draw comes from the JSON schema with the parameters of all installed plugins, so a new plugin, fault or
option is drawn without a change here. `fuzzing/vocabulary.py` says what was drawn.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

from fuzzing.draft import Draft, Tree
from fuzzing.ensembles import Ensembles
from fuzzing.foundations import foundation
from fuzzing.grammar import Grammar
from fuzzing.side_files import ASSETS
from fuzzing.values import Values
from fuzzing.vocabulary import events

#: The greatest number of bodies of the world, which keeps runs short.
_BODIES = 6

#: How often a feature is drawn until the scenario with it is valid.
_TRIES = 2

#: Keys whose values are not replaced by references to parameters, because they are looked up in the tree.
_PLAIN = frozenset({"symaware", "name", "use", "time_step", "duration", "count", "interval", "mode", "parameters"})


class Composer:
    """Draws scenarios.

    Args:
        schema: The JSON schema of scenarios.
        is_valid: Says whether a scenario is valid, and small enough to run.
    """

    def __init__(self, schema: Mapping[str, Any], is_valid: Callable[[Tree], bool]) -> None:
        self._is_valid = is_valid
        self._draft = Draft(schema["$defs"], events(schema))
        self._grammar = Grammar(self._draft)
        self._values = Values(self._draft, self._grammar)
        self._ensembles = Ensembles(self._draft, self._values)

    @property
    def _tree(self) -> Tree:
        return self._draft.tree

    def scenario(self, chance: Random) -> Tree:
        """Draw a scenario."""
        self._draft.chance = chance
        while True:
            tree = foundation(self._draft, self._values)
            if self._is_valid(tree):
                break
        features: list[Callable[[], None]] = [
            *([self._add_component] * chance.randint(2, 6)),
            *([self._add_timing] * chance.randint(0, 3)),
            *([self._add_fault] * chance.randint(0, 3)),
            *([self._add_specification] * chance.randint(1, 4)),
            *([self._add_entity] * chance.randint(0, 2)),
            *([self._add_joint] * (chance.random() < 0.3)),
            *([self._add_presence] * chance.randint(0, 2)),
            *([self._add_region] * chance.randint(0, 2)),
            *([self._add_offer] * (chance.random() < 0.25)),
            *([self._add_topology] * (chance.random() < 0.6)),
            *([self._add_options] * chance.randint(0, 3)),
            *([self._add_value] * (chance.random() < 0.3)),
            *([self._add_recording] * (chance.random() < 0.25)),
            *([self._add_limits] * (chance.random() < 0.3)),
            *([self._add_knowledge_model] * (chance.random() < 0.1)),
            *([self._add_header] * (chance.random() < 0.15)),
            *([self._ensembles.add] * (chance.random() < 0.3)),
        ]
        chance.shuffle(features)
        late = (self._add_fault, self._add_timing)
        features.sort(key=lambda add: add in late)
        if chance.random() < 0.3:
            features.append(self._add_parameter)
        for add in features:
            for _ in range(_TRIES):
                self._draft.tree = copy.deepcopy(tree)
                add()
                if self._tree != tree and self._is_valid(self._tree):
                    tree = self._tree
                    break
        return tree

    # What is added

    def _add_component(self) -> None:
        group = self._draft.group()
        names = [name for name in self._draft.plugins("component") if not name.startswith("perception")]
        use = self._values.use("component", self._draft.chance.choice(names))
        group["components"][use["use"].rpartition(".")[2]] = use

    def _add_timing(self) -> None:
        components = list(self._draft.group()["components"].values())
        if components:
            component = self._draft.chance.choice(components)
            component.update(self._values.options("ComponentUse", 1, without=("use", "with", "own")))

    def _add_options(self) -> None:
        """Add an option of a plugin or a body that is there."""
        chance, tree = self._draft.chance, self._tree
        group = self._draft.group()
        at = chance.choice([tree["environment"], group["model"], *group["components"].values()])
        kind = "environment" if at is tree["environment"] else "model" if at is group["model"] else "component"
        if chance.random() < 0.2:
            group["entity"] = {**group.get("entity", {}), **self._values.options("Entity", 1)}
            return
        at["with"] = {**at.get("with", {}), **self._values.options(f"{kind}:{at['use']}", 1)}

    def _add_value(self) -> None:
        """Give a group a state or knowledge in another form."""
        chance, group = self._draft.chance, self._draft.group()
        values = [[round(chance.uniform(-3, 3), 1) for _ in range(2)] for _ in range(group.get("count", 1))]
        drawn = self._values.distribution()
        if "choice" in drawn:
            drawn["choice"] = [[1, 2], [2, 1]]
        forms: list[Any] = [
            drawn,
            {"normal": [0.0, 1.0]},
            {"uniform": [[-1, -2], [1, 2]]},
            {"own": {0: [1, 2]}, "rest": [2, 1]},
        ]
        forms += [[{"uniform": [-1, 1]}, {"normal": [0, 0.5]}], {"each": values}, {"circle": {"radius": 2.0}}]
        key = chance.choice(["state", "goal"])
        if key == "state":
            group["state"] = chance.choice(forms)
        else:
            group.setdefault("knowledge", {})["goal"] = chance.choice(forms)

    def _add_fault(self) -> None:
        chance, fault = self._draft.chance, {}
        properties = self._draft.definitions["FaultUse"]["properties"]
        # Promises are hardly ever valid here, so that none could be kept.
        kind = chance.choice([name for name in properties if name not in ("at", "on", "for", "keep")])
        fault[kind] = self._values.value(properties[kind], kind, "FaultUse")
        if kind in ("reconfigure", "replace"):
            self._aim(kind, fault[kind])
        if kind in ("bias", "noise", "blind", "slow", "freeze", "restart") and self._draft.components():
            target = self._some_component("perception" if kind in ("bias", "noise", "blind") else "")
            fault[kind] = {**fault[kind], "of": target} if isinstance(fault[kind], dict) else target
        if kind in ("place", "push", "inform"):
            fault[kind]["of"] = chance.choice([*self._draft.agents(), *self._draft.groups()])
        if kind == "believe":
            fault[kind] |= {"about": chance.choice([*self._draft.agents(), *self._draft.groups()])}
            fault[kind]["part"] = chance.choice(["state", "intent"])
        when = "at" if chance.random() < 0.7 else "on"
        fault[when] = self._values.value(properties[when], when, "FaultUse")
        if chance.random() < 0.6 and kind not in ("restart", "restore", "prevent", "push", "place", "inform"):
            fault["for"] = self._values.value(properties["for"], "for", "FaultUse")
        faults = self._tree.setdefault("faults", {})
        faults[f"f{len(faults)}"] = fault

    def _some_component(self, family: str) -> str:
        """A component with plugins of a family, of a group, an agent, or of all groups."""
        chance = self._draft.chance
        found = [
            (name, component)
            for name, group in self._tree["agents"].items()
            for component, use in group["components"].items()
            if use["use"].startswith(family)
        ]
        if not found:
            return "*.sense"
        name, component = chance.choice(found)
        return f"{chance.choice([name, '*', chance.choice(self._draft.members(name))])}.{component}"

    def _aim(self, kind: str, fault: Tree) -> None:
        """Let a fault of a component have parameters of the component's plugin."""
        chance = self._draft.chance
        uses = [
            (f"{name}.{component}", use["use"])
            for name, group in sorted(self._tree["agents"].items())
            for component, use in sorted(group["components"].items())
        ]
        if not uses:
            return
        fault["of"], use = chance.choice(uses)
        if kind == "reconfigure":
            fault["with"] = self._values.options(f"component:{use}", 2)
        else:
            family = f"component:{use.partition('.')[0]}."
            fault.pop("with", None)
            fault.update(self._values.use("component", chance.choice(self._draft.plugins(family))))

    def _add_specification(self) -> None:
        specifications = self._tree["specifications"]
        specifications[f"s{len(specifications)}"] = self._specification()

    def _specification(self) -> Tree:
        chance = self._draft.chance
        scope = chance.choice(["each", "each", "pairs", "world"])
        made: Tree = {}
        group = chance.choice(self._draft.groups())
        if scope == "each":
            made["each"] = group
            if chance.random() < 0.3:
                made["of"], scope = "belief", "belief"
            elif chance.random() < 0.1:
                made["of"] = "truth"
        elif scope == "pairs":
            made["pairs"] = group if chance.random() < 0.5 else [chance.sample(self._draft.agents() * 2, 2)]
        if chance.random() < 0.2:
            made["logic"] = chance.choice(["ltl", "ltl", "stl"])
        ltl = made.get("logic") == "ltl"
        made["formula"] = self._grammar.formula(scope, chance.randint(1, 3), ltl=ltl)
        if chance.random() < 0.15:
            made["where"] = {"named": self._grammar.formula(scope, 0)}
            made["formula"] = f"({made['formula']}) and not named"
        others = ("formula", "each", "pairs", "of", "logic", "where", "offer")
        return {**made, **self._values.options("SpecificationUse", chance.choice([0, 0, 1, 2]), without=others)}

    def _add_offer(self) -> None:
        chance = self._draft.chance
        offer = self._values.options("OfferSection", chance.randint(0, 3))
        formula = self._grammar.formula("each", 2)
        group = chance.choice(self._draft.groups())
        self._tree["specifications"]["task"] = {"each": group, "offer": offer, "formula": formula}

    def _add_region(self) -> None:
        self._tree["regions"][f"r{len(self._tree['regions'])}"] = self._values.options("Region", 1)

    def _add_entity(self) -> None:
        entities = self._tree["environment"].setdefault("entities", {})
        schema = {"$ref": "#/$defs/Obstacle"}
        if len(entities) < _BODIES:
            entities[f"e{len(entities)}"] = self._values.value(schema, "entity", "EnvironmentUse")

    def _add_joint(self) -> None:
        """Connect two bodies that are moved by forces."""
        world = self._tree["environment"]
        if world["use"] != "pymunk":
            return
        entities = world.setdefault("entities", {})
        for number in range(2):
            body = {"shape": {"circle": {"radius": 0.2}}, "position": [number - 3.0, 2.0], "mass": 1.0}
            entities.setdefault(f"link{number}", body)
        joint = self._values.options("environment:pymunk:Joint", self._draft.chance.randint(0, 3))
        joint["between"] = self._draft.chance.choice([["link0", "link1"], ["link0", None]])
        needed = {"spring": ("length", "stiffness"), "motor": ("rate",), "slide": ("length",)}.get(joint["kind"], ())
        for name in needed:
            joint.setdefault(name, round(self._draft.chance.uniform(0.5, 1.5), 2))
        world["with"].setdefault("joints", {})["joint"] = joint

    def _add_presence(self) -> None:
        chance, group = self._draft.chance, self._draft.group()
        each = [self._values.options("Presence", chance.randint(1, 2)) for _ in range(group.get("count", 1))]
        group["present"] = each if chance.random() < 0.5 and "count" in group else each[0]

    def _add_topology(self) -> None:
        chance = self._draft.chance
        topology = self._values.use("topology", chance.choice(self._draft.plugins("topology")))
        options = self._values.options("TopologyUse", chance.randint(0, 3), without=("use", "with"))
        self._tree["topology"] = {**topology, **options}

    def _add_recording(self) -> None:
        self._tree["recording"] = self._values.options("Recording", self._draft.chance.randint(1, 2))

    def _add_limits(self) -> None:
        """Add an option of the run: another end, or what depends on the wall clock and changes nothing."""
        run = self._tree["run"]
        run.update(self._values.options("RunSection", 1, without=("duration", "mode")))
        if "workers" in run:
            run["workers"] = min(run["workers"], 2)

    def _add_knowledge_model(self) -> None:
        name = self._draft.chance.choice(self._draft.plugins("abstraction"))
        self._tree.setdefault("knowledge_models", {})["map"] = self._values.use("abstraction", name)

    def _add_header(self) -> None:
        """Add what has an effect in several processes only, or none."""
        chance = self._draft.chance
        match chance.choice(["transport", "transport", "assets", "description"]):
            case "transport":
                use = chance.choice(["tcp", "tcp", *self._draft.plugins("transport")])
                options = self._values.options(f"transport:{use}", chance.randint(0, 2), without=("members",))
                options |= {key: 4096 for key in options if key in ("queue", "maximum_frame")}
                self._tree["transport"] = {"use": use, "with": options}
            case "assets":
                self._tree["assets"] = [ASSETS]
            case _:
                self._tree["description"] = "Drawn at random."

    def _add_parameter(self) -> None:
        """Refer to values as parameters."""
        places = [each for each in _leaves(self._tree) if each[-1] not in _PLAIN and each[0] != "symaware"]
        parameters = self._tree.setdefault("parameters", {})
        for place in self._draft.chance.sample(places, min(3, len(places))):
            holder: Any = self._tree
            for key in place[:-1]:
                holder = holder[key]
            name = f"p{len(parameters)}"
            parameters[name] = holder[place[-1]]
            holder[place[-1]] = f"${{parameters.{name}}}"


def _leaves(value: Any, above: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The paths of all numbers and texts."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(inner, (*above, key))
    elif isinstance(value, int | float | str):
        yield above


def written(tree: Tree) -> bytes:
    """A scenario as JSON, which is valid YAML."""
    return json.dumps(tree, indent=1).encode()


class BuildFailure(Exception):  # noqa: N818 (what one looks for is not an error of the tool)
    """A scenario is neither valid nor refused: building it raises.

    Attributes:
        tree: The scenario.
    """

    def __init__(self, tree: Tree) -> None:
        super().__init__("building raises")
        self.tree = tree


def is_valid(tree: Tree, draft: Path, steps: int) -> bool:
    """Whether a scenario is valid, and has at most so many steps.

    Raises:
        BuildFailure: Building it raises anything but a refusal.
    """
    from symaware_cli.language import ScenarioError
    from symaware_cli.language.build import build

    draft.write_bytes(written(tree))
    try:
        built = build(draft)
    except ScenarioError:
        return False
    except Exception as error:
        raise BuildFailure(tree) from error
    with built.simulation.environment:
        return built.steps <= steps
