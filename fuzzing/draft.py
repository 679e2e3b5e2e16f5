"""A scenario in the making: what it has, and what there is in the language to add to it."""

from __future__ import annotations

from collections.abc import Mapping
from random import Random
from typing import Any

from fuzzing.side_files import NAMES

Tree = dict[str, Any]

#: Events that happen in most runs.
_COMMON = (
    *("contact", "goal-reached", "goal-changed", "violated", "satisfied", "fault", "fault-over", "added", "removed"),
    *("received", "dropped", "failed", "updated", "computed", "accepted", "offered", "stepped"),
)


class Draft:
    """A scenario in the making.

    Attributes:
        definitions: The definitions of the JSON schema.
        events: The names of all events.
        chance: Draws.
        tree: The scenario.
    """

    def __init__(self, definitions: Mapping[str, Any], events: list[str]) -> None:
        self.definitions = definitions
        self.events = events
        self.chance = Random()
        self.tree: Tree = {}

    @property
    def step(self) -> float:
        """The time step of the world [s]."""
        return float(self.tree["environment"]["with"]["time_step"])

    @property
    def duration(self) -> float:
        """The duration of the run [s]."""
        return float(self.tree["run"]["duration"])

    def group(self) -> Tree:
        """Some group."""
        found: Tree = self.chance.choice(list(self.tree["agents"].values()))
        return found

    def groups(self) -> list[str]:
        """The names of all groups."""
        return sorted(self.tree["agents"])

    def members(self, name: str) -> list[str]:
        """The ids of the agents of a group."""
        group = self.tree["agents"][name]
        return [f"{name}.{row}" for row in range(group["count"])] if "count" in group else [name]

    def agents(self) -> list[str]:
        """The ids of all agents."""
        return [id for name in self.tree["agents"] for id in self.members(name)]

    def components(self) -> list[str]:
        """All components, with the names of their groups."""
        return [f"{name}.{each}" for name, group in self.tree["agents"].items() for each in group["components"]]

    def bodies(self) -> list[str]:
        """The names of the bodies of the world."""
        return sorted(self.tree["environment"].get("entities", {}))

    def plugins(self, kind: str) -> list[str]:
        """The names of plugins, by the beginning of their definition."""
        return sorted(
            name.partition(":")[2] for name in self.definitions if name.startswith(kind) and name.count(":") == 1
        )

    def texts(self, name: str, owner: str) -> list[str]:
        """What a text for a key of a definition may be, or refer to."""
        tree, components = self.tree, self.components()
        match name:
            case "event":
                return [*_COMMON, *self.chance.sample(self.events, 3)]
            case "file":
                return NAMES.get(owner, ["nothing"])
            case "restart" | "freeze" | "blind":
                return [*components, *(f"*.{each.partition('.')[2]}" for each in components)]
            case "restore" | "prevent":
                return [*tree.get("faults", {}), "f0"]
            case "region" | "union" | "intersection" | "complement" | "obstacles" | "inside" | "regions":
                return sorted(tree["regions"])
            case "specification" | "specifications":
                return [*tree["specifications"], "s0"]
            case "model" | "models":
                return [*tree.get("knowledge_models", {}), "map"]
            case "names" | "knowledge" | "name":
                return [*self.group().get("knowledge", {}), "goal"]
            case "scan" | "strategy":
                # The first component of the first group is drawn when there is none yet.
                return [each.partition(".")[2] for each in components] or ["sense"]
            case "between" if owner.startswith("environment"):
                return [*self.bodies(), *self.agents()]
            case "around" | "leader" | "agent" | "cell_of" | "apart_from" | "whom" | "others" | "hub":
                return self.agents()
            case "description":
                return ["Drawn at random."]
            case "column":
                return ["prediction_error"]
            case "of":
                paths = [f"agents.{each}" for each in (*components, "*")]
                return [*self.agents(), *tree["agents"], *components, *paths, "environment", "*"]
        return [*self.agents(), *tree["agents"], *(f"{each}.*" for each in tree["agents"]), "*", *components]
