"""Auctions: agents bid for offered specifications by messages, and one of them, or all in agreement, assign these.

Reasons: docs/decisions/0044-auctions.md
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from symaware_cli.core import (
    EVERYBODY,
    Agent,
    AgentGroup,
    AwarenessDatabase,
    CommunicationReceiver,
    KnowledgeDatabase,
    Message,
    Parameters,
    nanoseconds,
    seconds,
)
from symaware_cli.geometry import Array

#: Totals that differ by less than this part of the greatest cost are equal.
_TOLERANCE = 1e-9
#: The kind of its messages.
AUCTION = "auction"


def assignment(costs: Mapping[str, Mapping[str, float]], agents: Sequence[str]) -> dict[str, str]:
    """Assign each task to one agent and each agent to at most one task.

    As many tasks as possible are assigned, and among these assignments one with the least total cost is chosen
    (H. W. Kuhn, *The Hungarian method for the assignment problem*, Naval Research Logistics Quarterly 2, 1955). Of
    several with the same total, the first task goes to the agent that comes first, then the second task, and so on.

    Args:
        costs: The cost of each agent that can do a task, by task and agent.
        agents: The agents in the order that breaks ties.

    Returns:
        The agent of each task that is assigned, in the order of the tasks.
    """
    from scipy.optimize import linear_sum_assignment

    tasks = list(costs)
    finite = [abs(cost) for each in costs.values() for cost in each.values()]
    if not finite:
        return {}
    largest = max(finite)
    # One assigned task more is worth more than any saving on the others.
    forbidden = 2.0 * (largest + 1.0) * (len(tasks) + 1)
    # Columns after those of the agents are for tasks that nobody gets, so that each row has one.
    table = np.full((len(tasks), len(agents) + len(tasks)), forbidden)
    for row, task in enumerate(tasks):
        for column, agent in enumerate(agents):
            if agent in costs[task]:
                table[row, column] = costs[task][agent]

    def least(table: Array) -> float:
        return float(table[linear_sum_assignment(table)].sum())

    total, tolerance = least(table), _TOLERANCE * (largest + 1.0)
    found: dict[str, str] = {}
    for row, task in enumerate(tasks):
        for column, agent in enumerate(agents):
            if agent not in costs[task] or agent in found.values():
                continue
            tried = table.copy()
            tried[row] = np.where(np.arange(table.shape[1]) == column, table[row], 2.0 * forbidden)
            if least(tried) <= total + tolerance:
                table, found[task] = tried, agent
                break
    return found


#: Cost and measured robustness of each specification, by name; the cost is None if the agent cannot take it.
Bids = Mapping[str, Sequence[float | None]]


class AuctionRound:
    """The bids and assignments of one round that an agent has heard of, its own included.

    Attributes:
        since: When its specifications were offered [ns].
        number: Its number, from 0.
        begin: When it begins, in nanoseconds.
        end: When bidding ends, in nanoseconds.
        bids: The bids by agent.
        assignments: Who is to have which specification, by the agent that says so.
        bid_at: When the agent has bid, in nanoseconds.
        is_closed: Whether bidding is over for this agent.
    """

    def __init__(self, since: int, number: int, deadline: int) -> None:
        self.since = since
        self.number = number
        self.begin = since + 2 * number * deadline
        self.end = self.begin + deadline
        self.bids: dict[str, Bids] = {}
        self.assignments: dict[str, dict[str, str]] = {}
        self.bid_at = -1
        self.is_closed = False

    def hear(self, payload: Mapping[str, Any]) -> None:
        """Add another agent's knowledge of the round to the own one. Bids count if they arrive before bidding ends."""
        if not self.is_closed:
            for agent, bids in payload["bids"].items():
                self.bids.setdefault(agent, bids)
        for author, assigned in payload["assignments"].items():
            self.assignments.setdefault(author, dict(assigned))

    def message(self) -> dict[str, Any]:
        """The agent's knowledge of the round, to be sent to others."""
        return {
            "since": self.since,
            "round": self.number,
            "bids": dict(self.bids),
            "assignments": {author: dict(each) for author, each in self.assignments.items()},
        }

    def assign(self, agents: Sequence[str], candidates: int | None) -> dict[str, str]:
        """Assign the specifications by the bids.

        Args:
            agents: The ids of all agents of the group, in the order that breaks ties.
            candidates: How many agents of the highest measured robustness are considered for each specification; None
                for all, 0 for as many as there are specifications.
        """
        names = sorted({name for bids in self.bids.values() for name in bids})
        most = len(names) if candidates == 0 else candidates
        costs: dict[str, dict[str, float]] = {}
        for name in names:
            bidders = [agent for agent in agents if name in self.bids.get(agent, ())]
            bidders.sort(key=lambda agent: -float(self.bids[agent][name][1] or 0.0))  # a stable sort: ties by agent
            offered = {agent: self.bids[agent][name][0] for agent in bidders[:most]}
            costs[name] = {agent: cost for agent, cost in offered.items() if cost is not None}
        return assignment(costs, agents)


def round_at(since: float, now: int, deadline: int) -> int:
    """The number of the round at a time, of the auction of specifications that were offered at `since` [s].

    A round lasts two deadlines: one for bids, one to tell who has won.
    """
    return (now - nanoseconds(since)) // (2 * deadline)


class Auction(CommunicationReceiver):
    """Auctions specifications that are offered among the agents of a group, by messages over the topology.

    Specifications that were offered at the same time are auctioned together, in rounds whose times follow from that
    time alone. For one `deadline`, agents send their bids and all bids that they have received. Then an agent assigns
    each specification to one bidder and each bidder at most one specification, as many as possible and at the least
    total cost; ties go to the agent that comes first. For another `deadline` it sends the result, and the winners
    accept. Specifications that are still open then are auctioned again in the next round. No agent waits for another:
    an agent whose messages do not arrive takes no part in a round.

    The auctioneer of a round is `auctioneer`, or the next agent from which a message has arrived in this round. With
    ``decision: consensus`` every agent assigns, and a winner accepts when it has received the same assignment from
    every agent whose bid it knows. Either way an agent accepts by a call that only one of them can make
    (`Component.accept`), so lost messages can delay an acceptance and never double it.

    A bid is the distance from satisfying the specification by the measured values (minus its robustness), or a value
    from another component of the agent. An agent does not accept anything by a bid from before its last acceptance.
    """

    events: ClassVar[Mapping[str, str]] = {
        "bid": "The agent tells its bids for a round.",
        "assigned": "The auctioneer has assigned specifications to bidders.",
        "unassigned": "No bidder can take a specification, or all that can have another one; it stays open.",
        "refused": "The agent has won what it cannot accept: it is not open any more, or the bid is outdated.",
    }

    class Parameters(Parameters):
        """The rounds, who decides, and the bids."""

        deadline: float = Field(
            1.0,
            gt=0,
            description="How long a round is open for bids, and then as long again for its result [s]. At least one "
            "turn and as long as a message takes; on topologies with several hops, as all hops take.",
        )
        decision: Literal["auctioneer", "consensus"] = Field(
            "auctioneer",
            description="Who decides: one agent, or all that have bid, who must come to the same assignment.",
        )
        auctioneer: str | None = Field(
            None, description="The id of the auctioneer, an agent of the group. By default its first agent."
        )
        candidates: Annotated[int, Field(ge=1)] | Literal["offered"] | None = Field(
            None,
            description="How many agents are considered for each specification: those with the highest robustness on "
            "what was measured. `offered`: as many as there are specifications in the round. By default all.",
        )
        bids: str | None = Field(
            None,
            min_length=1,
            description="The knowledge with the agent's bids, which another component writes: by specification the "
            "`cost`, null if the agent cannot take it, and `at`, when it was made [s]. Bids are removed from it once "
            "they are used or outdated. By default the cost is minus the robustness on what was measured.",
        )
        most: int | None = Field(
            None, ge=1, description="How many undecided specifications the agent has at most at a time."
        )

    @property
    def kinds(self) -> Collection[str]:
        """The kind of its messages."""
        return (AUCTION,)

    def check(self, group: AgentGroup) -> None:
        """Check that the auctioneer is an agent of the group."""
        auctioneer = self.parameters.auctioneer
        if auctioneer is not None and auctioneer not in group.ids:
            raise ValueError(f"the auctioneer `{auctioneer}` is none of its agents, which are {', '.join(group.ids)}")

    def initialise_component(
        self,
        agent: Agent,
        initial_awareness_database: AwarenessDatabase,
        initial_knowledge_database: Mapping[str, KnowledgeDatabase],
    ) -> None:
        """Start without rounds and without specifications."""
        super().initialise_component(agent, initial_awareness_database, initial_knowledge_database)
        ids = agent.group.ids
        first = 0 if self.parameters.auctioneer is None else ids.index(self.parameters.auctioneer)
        self._deadline = nanoseconds(self.parameters.deadline)
        #: All agents in the order in which they take over from the auctioneer.
        self._auctioneers = (*ids[first:], *ids[:first])
        self._rounds: list[AuctionRound] = []
        self._accepted: list[str] = []
        self._accepted_at = -1
        #: What the agent accepted or could not accept, with the time from which it was open [s].
        self._settled: dict[str, float] = {}

    def _update(self, value: Sequence[Message]) -> None:
        for message in value:
            self._round(message.payload["since"], message.payload["round"]).hear(message.payload)
        for each in self._rounds:
            if not each.is_closed and self.now >= each.end:
                self._close(each)
        for each in self._rounds:
            self._accept(each)
        over = [each for each in self._rounds if self.now >= each.end + self._deadline]
        self._discard_bids([name for each in over for name in each.bids.get(self._agent.id, ())])
        self._rounds = [each for each in self._rounds if each not in over]
        self._bid()
        for each in self._rounds:
            self.send(Message(self._agent.id, EVERYBODY, each.message(), AUCTION))

    def _round(self, since: int, number: int) -> AuctionRound:
        for each in self._rounds:
            if (each.since, each.number) == (since, number):
                return each
        self._rounds.append(AuctionRound(since, number, self._deadline))
        return self._rounds[-1]

    def _open(self) -> dict[str, Mapping[str, Any]]:
        """The terms of the offers that are open as far as the agent knows, by name, in the order of names."""
        return {
            name: terms
            for name, terms in sorted(self._agent.offers.items())
            if self._settled.get(name) != terms["since"]
        }

    def _bid(self) -> None:
        """Bid in the rounds that are open for bids."""
        offers = self._open()
        for since in sorted({terms["since"] for terms in offers.values()}):
            each = self._round(nanoseconds(since), round_at(since, self.now, self._deadline))
            if self.now >= each.end or self._agent.id in each.bids:
                continue
            names = [name for name, terms in offers.items() if terms["since"] == since]
            bids = self._bids(names, since)
            if bids is None:
                continue
            each.bids[self._agent.id] = bids
            each.bid_at = self.now
            told = ", ".join(f"{name} {'no' if bid[0] is None else f'{bid[0]:.3g}'}" for name, bid in bids.items())
            costs = {name: bid[0] for name, bid in bids.items()}
            self.emit("bid", told, round=each.number, since=since, costs=costs)

    def _bids(self, names: Sequence[str], since: float) -> Bids | None:
        """The agent's bids; None if the component that makes them is not ready."""
        agent = self._agent
        measured = {name: agent.measured_robustness(name) for name in names}
        status = agent.specifications
        held = [name for name in self._accepted if name in status and status[name].verdict is None]
        if self.parameters.most is not None and len(held) >= self.parameters.most:
            return {name: (None, measured[name]) for name in names}
        if self.parameters.bids is None:
            return {name: (-measured[name], measured[name]) for name in names}
        made = agent.self_knowledge.get(self.parameters.bids, {})
        if any(name not in made or not self._is_valid(made[name]["at"], since) for name in names):
            return None
        return {name: (made[name]["cost"], measured[name]) for name in names}

    def _is_valid(self, made_at: float, since: float) -> bool:
        """Whether a bid was made after the offer, and after the agent accepted something last."""
        return made_at >= since and nanoseconds(made_at) >= self._accepted_at

    def _discard_bids(self, names: Collection[str]) -> None:
        """Remove bids from the knowledge of the agent, so that new ones are made."""
        knowledge, key = self._agent.self_knowledge, self.parameters.bids
        if key is not None and any(name in knowledge.get(key, {}) for name in names):
            knowledge[key] = {name: bid for name, bid in knowledge[key].items() if name not in names}

    def _close(self, each: AuctionRound) -> None:
        """End the bidding of a round, and assign if it is this agent's turn to do so."""
        each.is_closed = True
        auctioneer = next((id for id in self._auctioneers if id in each.bids), None)
        if auctioneer is None or (auctioneer != self._agent.id and self.parameters.decision == "auctioneer"):
            return
        candidates = self.parameters.candidates
        assigned = each.assign(self._agent.group.ids, 0 if candidates == "offered" else candidates)
        each.assignments[self._agent.id] = assigned
        if auctioneer != self._agent.id:
            return  # in a consensus the first agent reports for all
        details: dict[str, Any] = {"round": each.number, "since": seconds(each.since), "bidders": [*each.bids]}
        if assigned:
            told = ", ".join(f"{name} to {agent}" for name, agent in assigned.items())
            self.emit("assigned", told, assignments=assigned, **details)
        for name in sorted({name for bids in each.bids.values() for name in bids} - set(assigned)):
            self.emit("unassigned", f"no bidder can take `{name}`", specification=name, **details)

    def _accept(self, each: AuctionRound) -> None:
        """Accept the specification that the agent has won in a round."""
        own = self._agent.id
        if own not in each.bids or not each.assignments:
            return
        if self.parameters.decision == "consensus":
            said = [each.assignments.get(agent) for agent in each.bids]
            if any(one != said[0] for one in said) or said[0] is None:
                return
        author = next(id for id in self._auctioneers if id in each.assignments)
        offers = self._open()
        for name, agent in each.assignments[author].items():
            if agent != own or name not in offers:
                continue
            terms = offers[name]
            if self._accepted_at > each.bid_at:
                self.emit("refused", f"the bid for `{name}` is outdated", specification=name, round=each.number)
                continue
            self._settled[name] = terms["since"]
            if self.accept(name):
                self._accepted.append(name)
                self._accepted_at = self.now
                self._discard_bids([*self._agent.self_knowledge.get(self.parameters.bids or "", ())])
                self._agent.self_knowledge.update(terms["knowledge"])
            else:
                self.emit("refused", f"`{name}` is not open", specification=name, round=each.number)
