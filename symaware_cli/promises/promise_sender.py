"""A component that sends the promises of its agents to other agents.

Reasons: docs/decisions/0108-told-promises.md
"""

from __future__ import annotations

from collections.abc import Iterable

from symaware_cli.core import CommunicationSender, Message, Parameters, ScenarioView
from symaware_cli.promises.promise import PROMISE, SECTION, Promises


class PromiseSender(CommunicationSender):
    """Sends an agent's promises, at each of its turns, to the agents that they are made to.

    Promises of agents with this component are known to another agent only from the arrival of a message on, which may
    be lost or late like any other. `promises.monitor` reads the messages. They are sent again at each turn (`period`),
    so a lost message delays a promise, and does not prevent it. A message contains the formula and the confidence of
    each promise. It is sent to the agents within reach at that time.
    """

    class Parameters(Parameters):
        """No parameters: the section `promises` has all settings."""

    def check_scenario(self, view: ScenarioView) -> None:
        """Warn of agents that make no promise."""
        if view.entry is None:
            return
        promises = view.entry.group.sections.get(SECTION)
        made = {each.of for each in promises.promises} if isinstance(promises, Promises) else set()
        if made.isdisjoint(view.entry.group.ids):
            view.warn("these agents make no promises", "use", expected="a section `promises`")

    def _compute(self) -> Iterable[Message]:
        promises, id = self._agent.group.sections.get(SECTION), self._agent.id
        if not isinstance(promises, Promises):
            return []
        own = [each for each in promises.promises if each.of == id]
        told: dict[str, dict[str, dict[str, object]]] = {}
        for other in self._surroundings.exchange.neighbours(id) if own else ():
            made = {
                each.name: {"formula": each.formula, "confidence": each.confidence} for each in own if other in each.to
            }
            if made:
                told[other] = made
        return [Message(id, other, {"promises": made}, PROMISE) for other, made in told.items()]
