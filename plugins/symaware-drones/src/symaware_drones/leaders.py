"""Leaders: the leading drone of each task of two, decided by token passing on the task graph."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from symaware_cli import (
    Agent,
    AgentGroup,
    AwarenessDatabase,
    CommunicationReceiver,
    KnowledgeDatabase,
    Level,
    Message,
    Parameters,
    Quantity,
    ScenarioView,
    Signal,
    nanoseconds,
)
from symaware_cli.formulas import Specification
from symaware_drones.schedule import task_graph
from symaware_drones.team import check_known, checked_tasks, order_of, tasks_in, tasks_of_agent

#: The kind of the messages.
LEADER = "leader"

#: Whom a drone leads, by their indices in the roster.
LEADS = Signal("leads", "table", [Quantity("agent", "1")], drawn="links", description="from the leader to the follower")


class Leaders(CommunicationReceiver):
    """Decides by messages between neighbours in the task graph which of them leads.

    A drone with exactly one undecided edge takes the lead of it and announces this; the other end, the follower,
    confirms. So leaders are decided from the leaves of each tree to its root, which has no follower. If both ends of
    the last edge take the lead at the same time, the one that comes first in the roster follows. Unconfirmed
    announcements are repeated at each turn; after `patience` the edge is given up, and its tasks are not pursued.

    It writes the knowledge `edges`: ``leader`` or ``follower`` by the id of the neighbour, once all are decided.
    """

    knowledge: ClassVar[Mapping[str, str]] = {"tasks": "the names of the tasks of the agent, alone or with others"}
    specifications = "tasks"
    specifications_of_others = True
    signals = (LEADS,)
    events: ClassVar[Mapping[str, str]] = {
        "decided": "The drone knows of each neighbour which of the two leads.",
        "undecided": "A neighbour does not answer; its edge is given up.",
    }

    class Parameters(Parameters):
        """The tasks."""

        tasks: list[str] = Field(min_length=1, description="The specifications that are tasks, of all drones.")
        patience: float = Field(0.5, gt=0, description="Longest wait for neighbours [s].")

    @property
    def kinds(self) -> Collection[str]:
        """The kind of its messages."""
        return (LEADER,)

    def check_specification(self, specification: Specification, group: AgentGroup) -> None:
        """Check that a specification is a task."""
        tasks_in(specification)

    def check_scenario(self, view: ScenarioView) -> None:
        """Check that the task graph has no cycle, and that there is a link for each of its edges."""
        tasks = checked_tasks(view.named_specifications, order_of(view.groups), view.links)
        check_known(tasks, view.groups)

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start with all edges undecided."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        order = order_of(self.environment.groups)
        graph = task_graph(tasks_of_agent(agent, order), order)
        self._order = order
        self._roles: dict[str, str] = dict.fromkeys(graph.get(agent.id, ()), "")
        self._claim: str | None = None
        self._is_decided = False

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            self._hear(message)
        if self._is_decided:
            return
        undecided = [id for id, role in self._roles.items() if not role]
        if len(undecided) == 1 and self._claim is None:
            self._claim = undecided[0]
        if undecided and self.now >= nanoseconds(self.parameters.patience):
            for id in undecided:
                self.emit("undecided", f"{id} does not answer", level=Level.WARNING, neighbour=id)
                self._roles[id] = "none"
            undecided = []
        elif self._claim in undecided:
            self._say(self._claim, "leader")
        if not undecided:
            self._is_decided = True
            self.agent.self_knowledge["edges"] = dict(self._roles)
            leads = [id for id, role in self._roles.items() if role == "leader"]
            follows = [id for id, role in self._roles.items() if role == "follower"]
            self.record(LEADS, np.array([[float(self._order[id])] for id in leads]).reshape(-1, 1))
            said = [f"leads {', '.join(leads)}"] * bool(leads) + [f"follows {', '.join(follows)}"] * bool(follows)
            self.emit("decided", "; ".join(said) or "has no neighbours", leads=leads, follows=follows)

    def _hear(self, message: Message) -> None:
        other, role = message.sender, message.payload["role"]
        if other not in self._roles:
            return
        if role == "follower":
            self._roles[other] = self._roles[other] or "leader"
            return
        if self._claim == other and self._order[other] < self._order[self.agent.id]:
            self._roles[other] = "leader"  # both took the lead: the first in the roster follows
        else:
            self._roles[other] = "follower"
            self._say(other, "follower")

    def _say(self, other: str | None, role: str) -> None:
        assert other is not None
        self.send(Message(self.agent.id, other, {"role": role}, kind=LEADER))
