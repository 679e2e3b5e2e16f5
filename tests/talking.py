"""A run of agents that exchange messages, with all events for tests."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self, TypeVar

from faulting import fault
from numpy.typing import ArrayLike
from simulating import Team, simulation

from symaware_cli import Agent, Component, ComponentSelection, Fault, GroupComponent, Topology
from symaware_cli.core import Event
from symaware_cli.engine.components.perception import SelfPerception
from symaware_cli.engine.network.channel.channel_parameters import ChannelParameters
from symaware_cli.engine.network.network import Network, TopologyPhase
from symaware_cli.engine.runtime.options import RunOptions
from symaware_cli.engine.runtime.run import run

Made = TypeVar("Made", bound=Component | GroupComponent)


class Setting(Component):
    """Does what a test says."""

    def __init__(self, act: Callable[[Agent], Any]) -> None:
        super().__init__()
        self._act = act

    def _compute(self) -> None:
        return None

    def _update(self, value: Any) -> None:
        self._act(self._agent)


class Watch:
    """A run, and what was fired in it."""

    def __init__(
        self,
        teams: Mapping[str, Team],
        topology: type[Topology] | None = None,
        channel: Mapping[str, Any] | None = None,
        seed: int = 7,
        **parameters: Any,
    ) -> None:
        self.simulation = simulation(teams, seed=seed)
        self.groups = {group.name: group for group in self.simulation.groups}
        self.events: list[Event] = []
        self.frames: list[Any] = []
        self.faults: list[Fault] = []
        if topology is not None:
            made = topology(topology.Parameters(**parameters))
            made.initialise(self.simulation.environment, seed)
            roster = self.simulation.environment.roster
            links = ChannelParameters.model_validate(channel or {})
            self.simulation.connect(Network(roster, [TopologyPhase(0, made)], channel=links))
        self.simulation.events.subscribe("*", self.events.append)

    def run(self, steps: int, look: Callable[[], Any] | None = None, status: str = "finished") -> Self:
        """Make the run; look at it after the turns of each step."""
        if look is not None:
            self.simulation.events.subscribe("iterated", lambda event: self.frames.append(look()))
        self.summary = run(self.simulation, steps, options=RunOptions(faults=self.faults))
        assert self.summary.status == status, self.summary.failure
        return self

    def fault(
        self,
        kind: type[Fault],
        group: str,
        component: str,
        step: int,
        steps: int | None = None,
        rows: Sequence[int] | None = None,
    ) -> Self:
        """Let something happen to a component just before the turns of a step, for some steps."""
        entry = next(each for each in self.simulation.entries if (each.group.name, each.name) == (group, component))
        concerned = ComponentSelection(entry, range(len(entry.group)) if rows is None else rows)
        name = f"fault {len(self.faults)}"
        self.faults.append(fault(kind, at=step, lasting=steps, name=name, components=[concerned]))
        return self

    def fired(self, name: str) -> list[Event]:
        return [event for event in self.events if event.name == name]


def made(kind: type[Made], **parameters: Any) -> Callable[[], Made]:
    return lambda: kind(kind.Parameters(**parameters))


def team(
    count: int = 2,
    control: Callable[[Agent], ArrayLike] | None = None,
    knowledge: Sequence[Mapping[str, object]] = (),
    **components: Callable[[], Component | GroupComponent],
) -> Team:
    def act(agent: Agent) -> None:
        if control is not None:
            agent.model.control_input = control(agent)

    each: dict[str, Callable[[], Component | GroupComponent]] = {
        "sense": SelfPerception,
        **components,
        "act": lambda: Setting(act),
    }
    return Team(each, count=count, knowledge=knowledge)
