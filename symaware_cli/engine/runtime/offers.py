"""Offers of specifications during a run: when they are made, which agents accept them, and which are rejected.

Reasons: docs/decisions/0040-offered-specifications.md
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from symaware_cli.core import AgentGroup, Event, seconds
from symaware_cli.core.verdict import OFFERS
from symaware_cli.engine.runtime.event_router import EventRouter
from symaware_cli.engine.runtime.simulation import Simulation
from symaware_cli.engine.runtime.timing import Trigger

if TYPE_CHECKING:
    from symaware_cli.specification import SpecificationMonitor

#: What agents are told of an offer: its formula and risk, when it begins, since and until when it is open [s], and what
#: comes with it.
TERMS = ("formula", "epsilon", "from", "since", "until", "knowledge")


class OfferState:
    """The state of an offer.

    Attributes:
        is_due: Whether the event has fired that brings it.
        is_made: Whether it was made.
        is_open: Whether it can be accepted.
        since: When it was made, or became open again, in nanoseconds.
        holder: The id of the agent that has accepted it; empty for none.
    """

    def __init__(self) -> None:
        self.is_due = False
        self.is_made = False
        self.is_open = False
        self.since = 0
        self.holder = ""


class Offers:
    """Offers specifications to agents, and keeps track of the agents that have accepted them.

    Everything that happens to an offer is an event of the source ``specifications.NAME``, and takes effect by that
    event alone. So a log has all that is needed to evaluate it again.

    Attributes:
        is_open: Whether the scenario has any.
    """

    uncaptured: ClassVar[Collection[str]] = ("_takes_part",)

    def __init__(
        self,
        simulation: Simulation,
        monitors: Mapping[str, SpecificationMonitor],
        triggers: Mapping[str, Trigger],
        router: EventRouter,
        takes_part: Callable[[AgentGroup, int], bool] | None,
    ) -> None:
        """Prepare.

        Args:
            simulation: The simulation.
            monitors: The monitors of all specifications, by name.
            triggers: The events that bring offers, by the names of the specifications.
            router: Connects events with their effects.
            takes_part: Tells whether an agent takes part in the run; None where the events of a log are repeated, which
                tell all.
        """
        self._simulation = simulation
        self._monitors = {
            name: monitor for name, monitor in monitors.items() if monitor.specification.offer is not None
        }
        self.is_open = bool(self._monitors)
        self._takes_part = takes_part
        self._states = {name: OfferState() for name in self._monitors}
        self._places = {id: (group, row) for group in simulation.groups for row, id in enumerate(group.ids)}
        for name in self._monitors:
            source = f"specifications.{name}"
            for event, call in (
                ("offered", self._on_offered),
                ("accepted", self._on_accepted),
                ("released", self._on_released),
                ("rejected", self._on_rejected),
            ):
                router.connect(event, source, partial(call, name))
            if takes_part is not None and name in triggers:
                trigger = triggers[name]
                router.connect(trigger.event, trigger.source, partial(self._on_trigger, name))
        if self._monitors:
            for group in simulation.groups:
                group.offers = self

    @property
    def holders(self) -> Mapping[str, str]:
        """The ids of the agents that have accepted specifications and not given them up, by the names of these."""
        return {name: state.holder for name, state in self._states.items() if state.holder}

    def update(self, now: int) -> None:
        """Make the offers that are due at a step, reopen those whose agents are gone, and reject late ones."""
        for name, state in self._states.items():
            monitor = self._monitors[name]
            offer = monitor.specification.offer
            assert offer is not None
            if not state.is_made:
                if state.is_due or (offer.at is not None and now >= offer.at):
                    self._announce("offered", name, f"`{name}` is offered", **self._terms(monitor, now))
            elif state.holder:
                group, row = self._places[state.holder]
                if not monitor.verdicts[row] and self._takes_part is not None and not self._takes_part(group, row):
                    text = f"`{name}` is open again: {state.holder} takes no part any more"
                    self._announce("released", name, text, agent=state.holder, **self._terms(monitor, now))
            elif state.is_open and offer.open_for is not None and now > state.since + offer.open_for:
                self._reject(name, f"nobody has accepted it by {seconds(state.since + offer.open_for):g} s")

    def finish(self) -> None:
        """Reject the open offers when the run ends."""
        for name, state in self._states.items():
            if state.is_open:
                self._reject(name, "nobody has accepted it by the end of the run")

    def accept(self, name: str, agent: str, path: str) -> bool:
        """Accept an offer for an agent.

        Args:
            name: The name of the specification.
            agent: The id of the agent.
            path: The path of the component that accepts.

        Returns:
            Whether the agent has accepted it, now or before.

        Raises:
            ValueError: The specification is never offered, or it is about the agents of another group.
        """
        if name not in self._states:
            raise ValueError(f"no specification `{name}` is offered in this scenario")
        monitor, state = self._monitors[name], self._states[name]
        group, row = self._places[agent]
        if group.name != monitor.specification.each:
            raise ValueError(f"`{name}` is about agents of `{monitor.specification.each}`, which {agent} is not")
        if state.is_open and monitor.is_open_to(row):
            offer = monitor.specification.offer
            assert offer is not None
            self._announce(
                "accepted", name, f"`{name}` is accepted by {agent}", agent=agent, by=path, epsilon=offer.epsilon
            )
        return state.holder == agent

    def open_to(self, group: str) -> Collection[str]:
        """The names of the specifications that agents of a group can accept now."""
        return [
            name
            for name, state in self._states.items()
            if state.is_open and self._monitors[name].specification.each == group
        ]

    def _announce(self, event: str, name: str, text: str, **data: Any) -> None:
        self._simulation.announce(event, f"specifications.{name}", text, specification=name, **data)

    def _reject(self, name: str, reason: str) -> None:
        self._announce("rejected", name, f"`{name}` is rejected: {reason}", reason=reason)

    @staticmethod
    def _terms(monitor: SpecificationMonitor, now: int) -> dict[str, Any]:
        """The terms of an offer that is made, or becomes open again, as agents receive them."""
        specification = monitor.specification
        offer = specification.offer
        assert offer is not None
        begun = min((cohort.start for cohort in monitor.cohorts), default=max(now, specification.start))
        return {
            "formula": specification.text,
            "epsilon": offer.epsilon,
            "from": seconds(begun),
            "since": seconds(now),
            "until": None if offer.open_for is None else seconds(now + offer.open_for),
            "knowledge": dict(offer.knowledge),
        }

    def _on_trigger(self, name: str, event: Event) -> None:
        self._states[name].is_due = True

    def _on_offered(self, name: str, event: Event) -> None:
        state, monitor = self._states[name], self._monitors[name]
        if not state.is_made:
            state.is_made, state.is_open, state.since = True, True, event.time
            monitor.begin(range(monitor.specification.scope.rows))
            self._tell(name, event.data)

    def _on_accepted(self, name: str, event: Event) -> None:
        state = self._states[name]
        state.holder, state.is_open = str(event.data["agent"]), False
        self._monitors[name].accept(self._places[state.holder][1])
        self._tell(name, None)

    def _on_released(self, name: str, event: Event) -> None:
        state = self._states[name]
        if state.holder:
            self._monitors[name].release(self._places[state.holder][1])
        state.holder, state.is_open, state.since = "", True, event.time
        self._tell(name, event.data)

    def _on_rejected(self, name: str, event: Event) -> None:
        self._states[name].is_open = False
        self._monitors[name].rejection = str(event.data["reason"])
        self._tell(name, None)

    def _tell(self, name: str, terms: Mapping[str, Any] | None) -> None:
        """Change the knowledge of the agents that receive an offer; without terms it is no longer open."""
        offer = self._monitors[name].specification.offer
        assert offer is not None
        for id in offer.to:
            group, row = self._places[id]
            known = {key: each for key, each in group.knowledge[row].get(OFFERS, {}).items() if key != name}
            if terms is not None:
                known[name] = {key: terms[key] for key in TERMS}
            group.knowledge[row][OFFERS] = known
