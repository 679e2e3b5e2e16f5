"""One round of an auction, as far as one agent has heard of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from symaware_cli.components.allocation.assignment import assignment
from symaware_cli.core import nanoseconds

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
        """Take over what another agent knows of the round. Bids count if they are heard before bidding ends."""
        if not self.is_closed:
            for agent, bids in payload["bids"].items():
                self.bids.setdefault(agent, bids)
        for author, assigned in payload["assignments"].items():
            self.assignments.setdefault(author, dict(assigned))

    def message(self) -> dict[str, Any]:
        """What the agent knows of the round, to tell others."""
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
    """The number of the round at a time, of the auction of what was offered at `since` [s].

    A round lasts two deadlines: one for bids, one to tell who has won.
    """
    return (now - nanoseconds(since)) // (2 * deadline)
