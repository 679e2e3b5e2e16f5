"""A run of agents who talk, of which tests see all that happens."""

from simulating import STEP, Team, simulation

from symaware_cli import Component
from symaware_cli.components.perception import SelfPerception
from symaware_cli.network.channel.channel_parameters import ChannelParameters
from symaware_cli.network.network import Network, TopologyPhase
from symaware_cli.runtime.faults import ComponentSelection, Fault
from symaware_cli.runtime.options import RunOptions
from symaware_cli.runtime.run import run


class Setting(Component):
    """Does what a test says."""

    def __init__(self, act):
        super().__init__()
        self._act = act

    def _compute(self):
        return None

    def _update(self, value):
        self._act(self._agent)


class Watch:
    """A run, and what was fired in it."""

    def __init__(self, teams, topology=None, channel=None, seed=7, **parameters):
        self.simulation = simulation(teams, seed=seed)
        self.groups = {group.name: group for group in self.simulation.groups}
        self.events = []
        self.frames = []
        self.faults = []
        if topology is not None:
            made = topology(topology.Parameters(**parameters))
            made.initialise(self.simulation.environment, seed)
            roster = self.simulation.environment.roster
            channel = ChannelParameters.model_validate(channel or {})
            self.simulation.connect(Network(roster, [TopologyPhase(0, made)], channel=channel))
        self.simulation.events.subscribe("*", self.events.append)

    def run(self, steps, look=None, status="finished"):
        """Make the run; look at it after the turns of each step."""
        if look is not None:
            self.simulation.events.subscribe("iterated", lambda event: self.frames.append(look()))
        self.summary = run(self.simulation, steps, options=RunOptions(faults=self.faults))
        assert self.summary.status == status, self.summary.failure
        return self

    def fault(self, effect, group, component, step, steps=None, rows=None):
        """Let something happen to a component just before the turns of a step, for some steps."""
        entry = next(each for each in self.simulation.entries if (each.group.name, each.name) == (group, component))
        concerned = ComponentSelection(entry, range(len(entry.group)) if rows is None else rows)
        lasting = None if steps is None else steps * STEP
        name = f"fault {len(self.faults)}"
        self.faults.append(Fault(name, name, entry.path, effect([concerned]), step * STEP, lasting=lasting))
        return self

    def fired(self, name):
        return [event for event in self.events if event.name == name]


def made(kind, **parameters):
    return lambda: kind(kind.Parameters(**parameters))


def team(count=2, control=None, knowledge=(), **components):
    def act(agent):
        if control is not None:
            agent.model.control_input = control(agent)

    each = {"sense": SelfPerception, **components, "act": lambda: Setting(act)}
    return Team(each, count=count, knowledge=knowledge)
