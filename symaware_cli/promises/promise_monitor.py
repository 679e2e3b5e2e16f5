"""A component that monitors the promises of others on the beliefs of its agents.

Reasons: docs/decisions/0099-promises.md
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from symaware_cli.core import (
    AgentGroup,
    Delivery,
    GroupCommunicationReceiver,
    Level,
    Parameters,
    Quantity,
    ScenarioView,
    Signal,
)
from symaware_cli.geometry import Array, Mask, Pieces
from symaware_cli.promises.breach import breach_probability
from symaware_cli.promises.promise import PROMISE, SECTION, TRUST, Promise, Promises, Reliance

#: The greatest probability with which an agent believes that a promise to it is broken now.
BREACH = Signal(
    "breach",
    columns=[Quantity("breach", "1")],
    description="the greatest probability, of all promises to the agent, that one is broken at this instant",
)


class Watched(NamedTuple):
    """A promise to one agent of the group.

    Attributes:
        row: The row of the agent.
        other: The index in the roster of the agent that promised.
        promise: The promise.
    """

    row: int
    other: int
    promise: Promise


class Watching(NamedTuple):
    """The result of a turn.

    Attributes:
        told: The messages of others that arrived, about their promises.
        probability: The probability that each promise is broken now; 0 if the position of the other is unknown.
    """

    told: Sequence[Delivery]
    probability: Array


class PromiseMonitor(GroupCommunicationReceiver):
    """Monitors for each agent the promises that others made to it, and computes its trust in them.

    At each turn, the probability that a promise is broken follows from the believed position of the other and its
    covariance (`breach_probability`, a lower bound). If it exceeds the confidence of the promise, the event
    ``promise-broken`` is fired, once for each promise, followed by the reaction that the promise declares as
    `on_broken`. The component belongs after those that perceive others and estimate their covariances; a position
    without a covariance counts as exact. Promises are known from the beginning of the run, or, if the agent that makes
    them has `promises.tell`, from the arrival of a message on, when the event ``promise-received`` is fired.

    The part of awareness `trust` has, for each other agent, the share of its promises that it kept as far as the agent
    knows, and whether the agent relies on them. If so, predictions may confine the other to its promised regions
    (`AgentGroup.confined`). An agent that stops requests a standstill in all later turns, in place of the requests of
    earlier controllers.
    """

    parts: ClassVar = (TRUST,)
    signals: ClassVar = (BREACH,)
    events: ClassVar = {
        "promise-broken": "An agent believes that another has broken a promise, with a `probability` above its "
        "confidence.",
        "promise-relied-on": "An agent relies on a promise from now on; says which of its components include the "
        "probability that it is broken, and which hold if it is kept.",
        "promise-received": "The agent received the first message about a promise of another.",
    }
    #: These attributes follow from the scenario.
    uncaptured: ClassVar[Sequence[str]] = ("_promises", "_sets", "_watched")

    class Parameters(Parameters):
        """No parameters: the section `promises` has all settings."""

    def check_scenario(self, view: ScenarioView) -> None:
        """Warn of a monitor without promises, and refuse one whose standstill a later controller would undo."""
        if view.entry is None:
            return
        promises = view.entry.group.sections.get(SECTION)
        found = promises if isinstance(promises, Promises) else Promises((), {})
        own = [each for id in view.entry.group.ids for each in found.to(id)]
        if not own:
            view.warn("there are no promises to these agents", "use", expected="a section `promises`")
        if any(each.on_broken == "stop" for each in own):
            for after in view.after:
                if after.use.startswith("control."):
                    said = f"a broken promise is to stop these agents, and `{after.name}` moves them after that"
                    view.report(said, "use", key=False, expected=f"the monitor after `{after.name}`")

    def initialise_component(self, group: AgentGroup) -> None:
        """Start with trust in all promises."""
        super().initialise_component(group)
        promises, roster = group.sections.get(SECTION), self.environment.roster
        found = promises if isinstance(promises, Promises) else Promises((), {})
        self._promises, self._start = found, roster.start(group.name)
        #: By agent, then by name, as `Promises` has them.
        self._watched = tuple(
            Watched(row, roster.indices[each.of], each) for row, id in enumerate(group.ids) for each in found.to(id)
        )
        self._sets = Pieces.of(each.promise.piece for each in self._watched)
        self._broken: Mask = np.zeros(len(self._watched), bool)
        self._stopped: Mask = np.zeros(len(group), bool)
        #: Whether it was said that the promise is relied on.
        self._said: Mask = np.zeros(len(self._watched), bool)
        group.awareness[TRUST.name] = np.ones((len(group), 2))
        self._write_trust()

    @property
    def kinds(self) -> Collection[str]:
        """The kind of messages that it reads: promises."""
        return (PROMISE,)

    def _compute(self) -> Watching:
        return Watching(super()._compute(), self._breach())

    def _breach(self) -> Array:
        """Return the probability that each promise is broken; 0 if the position of the other is unknown."""
        tracks = self._group.others(np.inf)
        rows = np.full(len(self._watched), -1, np.intp)
        for place, each in enumerate(self._watched):  # pairs of agents have no columns
            first, last = tracks.pointers[each.row : each.row + 2].tolist()
            found = first + int(np.searchsorted(tracks.others[first:last], each.other))
            if found < last and tracks.others[found] == each.other:
                rows[place] = found
        known = np.flatnonzero(rows >= 0)
        probability = np.zeros(len(rows))
        if len(known):
            of = rows[known]
            covariances = np.zeros((len(of), 2, 2))
            if tracks.covariances is not None:
                covariances = tracks.covariances[of][:, :2, :2]
            probability[known] = breach_probability(tracks.positions[of, :2], covariances, self._sets.take(known))
        return probability

    def _update(self, value: Sequence[Delivery] | Watching) -> None:
        assert isinstance(value, Watching)
        learnt = self._learn(value.told)
        known = self._known()
        probability = np.where(known, value.probability, 0.0)
        greatest = np.zeros(len(self._group))
        np.maximum.at(greatest, [each.row for each in self._watched], probability)
        self.record(BREACH, greatest[:, None])
        confidence = np.array([each.promise.confidence for each in self._watched])
        broken = np.flatnonzero((probability > confidence) & ~self._broken)
        self._broken[broken] = True
        for place in broken.tolist():
            row, _, promise = self._watched[place]
            breach = float(probability[place])
            said = f"{promise.of} has broken `{promise.name}`, with a probability of {breach:.4g}"
            facts = {"promise": promise.name, "of": promise.of, "probability": breach}
            self.emit_for(row, "promise-broken", said, level=Level.WARNING, **facts)
            self._stopped[row] |= promise.on_broken == "stop"
        if learnt or len(broken):
            self._write_trust()
        self._say_relied(known)
        if self._stopped.any():
            self._stop()

    def _say_relied(self, known: Mask) -> None:
        """Report for each promise, once it is known, the results that hold only if it is kept."""
        reliance = self._promises.reliance.get(self._group.name, Reliance())
        new = np.flatnonzero(known & ~self._said)
        self._said = self._said | known
        if not any(reliance):
            return
        for place in new.tolist():
            row, _, promise = self._watched[place]
            self.emit_for(
                row,
                "promise-relied-on",
                reliance.of(promise),
                promise=promise.name,
                of=promise.of,
                confidence=promise.confidence,
                paid=[*reliance.paid],
                if_kept=[*reliance.if_kept],
            )

    def _known(self) -> Mask:
        """Return which of the promises their receivers know."""
        if not any(each.promise.is_told for each in self._watched):
            return np.ones(len(self._watched), bool)
        known = [
            {(each.of, each.name) for each in self._promises.known(self._group, row)} for row in range(len(self._group))
        ]
        return np.array([(each.promise.of, each.promise.name) in known[each.row] for each in self._watched], bool)

    def _learn(self, told: Sequence[Delivery]) -> bool:
        """Store the promises in messages, and return whether any of them was unknown."""
        learnt = False
        for delivery in told:
            for message in delivery.messages(self.environment.roster.ids):
                row = self.environment.roster.index(message.receiver) - self._start
                for each in self._promises.learn(self._group, row, message.sender, message.payload["promises"]):
                    learnt = True
                    said = f"{each.of} promises `{each.name}`: {each.formula}"
                    self.emit_for(row, "promise-received", said, promise=each.name, of=each.of)
        return learnt

    def _write_trust(self) -> None:
        """Write the trust of each agent in each other that made a promise to it."""
        known = self._known()
        pairs: dict[tuple[int, int], list[int]] = {}
        for place, each in enumerate(self._watched):
            pairs.setdefault((each.row, each.other), []).append(place)
        roster, own = self.environment.roster, np.ones((len(self._group), 2))
        for (row, other), places in pairs.items():
            told = [place for place in places if known[place]]
            kept = sum(not self._broken[place] for place in told) / len(told) if told else 1.0
            distrusted = any(
                self._broken[place] and self._watched[place].promise.on_broken != "event" for place in places
            )
            trust = np.array([kept, 1.0 if told and not distrusted else 0.0])
            self._group.agents[row].awareness_database.set_part(TRUST.name, roster.ids[other], trust)
            own[row] = np.minimum(own[row], trust)
        self._group.awareness[TRUST.name] = own

    def _stop(self) -> None:
        """Request a standstill for the agents that stopped."""
        group, rows = self._group, self._stopped
        requested = group.control_input
        try:
            slowed = group.model.slowed(group.awareness.state, requested, np.zeros(len(group)))
        except NotImplementedError:
            slowed = np.zeros_like(requested)
        group.control_input = np.where(rows[:, None], group.model.limit(slowed), requested)
