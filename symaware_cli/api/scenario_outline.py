"""The outline of a scenario: its groups of agents, environment and duration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from symaware_cli.api.report import TextReport, listed, number

if TYPE_CHECKING:
    from symaware_cli.scenario.build import Built


@dataclass(frozen=True, slots=True)
class GroupOutline:
    """One group of agents.

    Attributes:
        agents: Their ids, in the order of rows.
        model: The entry-point name of their model.
        components: The entry-point names of their components, by name, in the order of turns.
    """

    agents: Sequence[str]
    model: str
    components: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Outline:
    """An overview of a valid scenario.

    Attributes:
        name: Its name.
        seed: The seed in force.
        mode: ``synchronous`` or ``asynchronous``.
        pace: Simulated seconds per second of wall time; None for as fast as possible.
        environment: The entry-point name of the world.
        entities: The other bodies in the world.
        groups: The groups of agents, by name.
        time_step: Simulated time between two steps [s].
        steps: The greatest number of steps.
        duration: Simulated time of these steps [s].
        digest: A digest of the scenario, in hexadecimal digits.
    """

    name: str
    seed: int
    mode: str
    pace: float | None
    environment: str
    entities: Sequence[str]
    groups: Mapping[str, GroupOutline]
    time_step: float
    steps: int
    duration: float
    digest: str

    @property
    def agents(self) -> int:
        """The number of agents."""
        return sum(len(group.agents) for group in self.groups.values())

    @property
    def headline(self) -> str:
        """A summary in one line."""
        groups = number(len(self.groups), "group")
        return f"{number(self.agents, 'agent')} in {groups}, {self.steps:,} steps"

    @property
    def report(self) -> TextReport:
        """The outline for people."""
        pace = f", {self.pace:g} x real time" if self.pace else ""
        entities = f" with {listed(self.entities)}" if self.entities else ""
        facts = [
            ("run", f"{self.duration:g} s in steps of {self.time_step:g} s, {self.mode}{pace}, seed {self.seed}"),
            ("environment", f"{self.environment}{entities}"),
        ]
        for name, group in self.groups.items():
            uses = listed(f"{component} ({use})" for component, use in group.components.items()) or "no components"
            facts.append((name, f"{number(len(group.agents), 'agent')}, {group.model}: {uses}"))
        return TextReport(f"{self.name}: {self.headline}", facts)


def outline(built: Built) -> Outline:
    """Return the outline of a valid scenario."""
    document, simulation = built.document, built.simulation
    time_step = simulation.environment.time_step
    return Outline(
        name=document.name,
        seed=document.seed,
        mode=document.run.mode,
        pace=document.run.pace,
        environment=document.environment.use,
        entities=tuple(document.environment.entities),
        groups={
            group.name: GroupOutline(group.ids, built.uses[group.name]["model"], built.uses[group.name]["components"])
            for group in simulation.groups
        },
        time_step=time_step / 1e9,
        steps=built.steps,
        duration=built.steps * time_step / 1e9,
        digest=built.digest.hex(),
    )
