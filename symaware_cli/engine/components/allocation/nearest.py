"""Allocation without negotiation: each agent accepts the specification that it is nearest to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import Field

from symaware_cli.core import Agent, AwarenessDatabase, Component, KnowledgeDatabase, Parameters


class NearestOffer(Component):
    """Accepts, of the specifications that are offered as far as the agent knows, the nearest one.

    The nearest is the one with the greatest robustness by the measured values: for `eventually inside(position, shelf)`
    this is minus the distance to the shelf. The agent then adds the knowledge in the offer, such as its next `goal`, to
    its own. It accepts the next specification when the last one is decided. Agents do not negotiate: the first agent to
    accept a specification has it, and of several in the same instant the first in the order of the scenario's turns.
    `communication.flooding` with `names: [offers]` passes offers on to other agents.
    """

    events: ClassVar[Mapping[str, str]] = {"too-late": "The agent would have accepted an offer that is not open to it."}

    class Parameters(Parameters):
        """How much an agent accepts."""

        least: float | None = Field(
            None,
            description="The least robustness with which the agent accepts something: -10 for regions at most 10 m "
            "away. Anything if left out.",
        )
        most: int = Field(1, ge=1, description="How many undecided specifications the agent has at most at a time.")

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start without any specification."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        self._accepted: list[str] = []
        #: What the agent could not accept, with the time from which it was open [s].
        self._refused: dict[str, float] = {}

    def _compute(self) -> Mapping[str, Any]:
        """Return the terms of the open offers, the nearest first, if the agent can accept one."""
        agent = self._agent
        status = agent.specifications
        held = [name for name in self._accepted if name in status and status[name].verdict is None]
        offers = {
            name: terms
            for name, terms in agent.offers.items()
            if self._refused.get(name) != terms["since"] and name not in self._accepted
        }
        if len(held) >= self.parameters.most or not offers:
            return {}
        least = -math.inf if self.parameters.least is None else self.parameters.least
        near = {name: near for name in offers if (near := agent.measured_robustness(name)) >= least}
        return {name: offers[name] for name in sorted(near, key=lambda name: (-near[name], name))}

    def _update(self, value: Mapping[str, Any]) -> None:
        for name, terms in value.items():
            if self.accept(name):
                self._accepted.append(name)
                self._agent.self_knowledge.update(terms["knowledge"])
                return
            self._refused[name] = terms["since"]
            self.emit("too-late", f"`{name}` is not open", specification=name)
