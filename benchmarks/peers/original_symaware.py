"""The original SymAware framework: point masses to their goals; prints CPU time and agent-steps.

``symaware.base`` must be importable; the history of the repository zhang-zengjie/tasmas-symaware-base has it. This is
its own loop, without the sleep that `AgentCoordinator.run` makes between two steps. It cannot record.
"""

import argparse
import json
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from symaware.base import (
    Agent,
    AwarenessVector,
    Controller,
    DefaultPerceptionSystem,
    DynamicalModel,
    Entity,
    Environment,
    TimeSeries,
)

Array = NDArray[np.float64]

STEP = 0.05


class PointMass(DynamicalModel):
    """A velocity that is followed at once."""

    def __init__(self, agent: int, state: Array) -> None:
        super().__init__(agent, np.zeros(2))
        self.state = state

    def initialise(self) -> None:
        """Nothing to do."""

    def step(self) -> None:
        """Move for one time step."""
        self.state = self.state + STEP * self._control_input

    @property
    def subinputs_dict(self) -> dict[str, Array]:
        """The input by its parts."""
        return {"velocity": self._control_input}


@dataclass(frozen=True)
class Body(Entity):
    """A body that moves as its model does."""

    def initialise(self) -> None:
        """Nothing to do."""


class Plane(Environment):
    """An empty plane."""

    def _add_entity(self, entity: Entity) -> None:
        entity.initialise()

    def get_entity_state(self, entity: Entity) -> Any:
        """The state of the body's model."""
        return entity.model.state

    def initialise(self) -> None:
        """Nothing to do."""

    def stop(self) -> None:
        """Nothing to do."""

    def step(self) -> None:
        """Move everybody."""
        for entity in self.entities:
            entity.step()


class ToGoal(Controller):
    """Heads for the goal."""

    def _compute(self) -> tuple[Array, TimeSeries]:
        return self._agent.knowledge_database[self._agent_id]["goal"] - self._agent.self_state, TimeSeries()


class AwareToGoal(ToGoal):
    """Reads what it believes of every other agent, and heads for its goal."""

    def _compute(self) -> tuple[Array, TimeSeries]:
        own = self._agent_id
        others = [vector.state for other, vector in self._agent.awareness_database.items() if other != own]
        assert others
        return super()._compute()


parser = argparse.ArgumentParser()
parser.add_argument("agents", type=int)
parser.add_argument("steps", type=int)
parser.add_argument("--aware", action="store_true", help="controllers read what they believe of all others")
arguments = parser.parse_args()
AGENTS = arguments.agents
random = np.random.default_rng(1)
side = math.sqrt(20.0 * AGENTS)
world, agents = Plane(), []
controller = AwareToGoal if arguments.aware else ToGoal
for number in range(AGENTS):
    start, goal = random.uniform(0.0, side, (2, 2))
    agent = Agent(number, Body(number, PointMass(number, start)))
    world.add_agents(agent)
    agent.add_components(DefaultPerceptionSystem(number, world), controller(number))
    agent.initialise_agent(AwarenessVector(number, start), {number: {"goal": goal}})
    agents.append(agent)


def steps(count: int) -> None:
    """Make some steps."""
    for _ in range(count):
        world.step()
        for each in agents:
            each.step()


steps(2)
started = time.process_time()
steps(arguments.steps)
cpu = time.process_time() - started
print(json.dumps({"cpu": cpu, "agent_steps": AGENTS * arguments.steps}))
