"""Families of components of single agents: the value that each computes, and its use."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.awareness import TimeSeries
from symaware_cli.core.component import Component
from symaware_cli.core.message import Message
from symaware_cli.core.waiting import MessageWait, Wait
from symaware_cli.world import Snapshot, real

Array = NDArray[np.float64]


class PerceptionSystem(Component):
    """Perceives states in the environment.

    `_compute` returns the perceived states by id, each in the order of that agent's model (or its position and
    velocity, or its position alone), or a `Snapshot` if it perceives everything. `Snapshot.states_by_id` has the states
    of all agents without a copy.
    """

    sees_world = True

    @abstractmethod
    def _compute(self) -> Mapping[str, ArrayLike] | Snapshot:
        """Return the perceived states."""

    def perceive_self_state(self) -> Array:
        """The agent's own true state, read-only; shape (nx,)."""
        state: Array = self.environment.state(self._agent.group)[self._agent.row]
        return state

    def misfit(self, value: Any) -> str | None:
        """A perception returns states by id."""
        if isinstance(value, Mapping | Snapshot):
            return None
        return (
            f"`_compute` returned {_described(value)}: a perception returns states by id, or a Snapshot of all agents"
        )

    def _update(self, value: Mapping[str, ArrayLike] | Snapshot) -> None:
        database = self._agent.awareness_database
        if isinstance(value, Snapshot):
            database.see(value)
        else:
            database.set_states(value)


class UncertaintyEstimator(Component):
    """Estimates the uncertainty of the agent's belief; `_compute` returns a `TimeSeries`."""

    @abstractmethod
    def _compute(self) -> TimeSeries:
        """Estimate the uncertainty."""

    def misfit(self, value: Any) -> str | None:
        """An uncertainty estimator returns a series."""
        if isinstance(value, TimeSeries):
            return None
        return f"`_compute` returned {_described(value)}: an uncertainty estimator returns a TimeSeries"

    def _update(self, value: TimeSeries) -> None:
        self._agent.self_awareness.uncertainty = value


class RiskEstimator(Component):
    """Estimates the risk of the agent's situation; `_compute` returns a `TimeSeries`."""

    @abstractmethod
    def _compute(self) -> TimeSeries:
        """Estimate the risk."""

    def misfit(self, value: Any) -> str | None:
        """A risk estimator returns a series."""
        if isinstance(value, TimeSeries):
            return None
        return f"`_compute` returned {_described(value)}: a risk estimator returns a TimeSeries"

    def _update(self, value: TimeSeries) -> None:
        self._agent.self_awareness.risk = value


class CommunicationSender(Component):
    """Sends messages to other agents; `_compute` returns the messages."""

    @abstractmethod
    def _compute(self) -> Iterable[Message]:
        """Return the messages to send."""

    def misfit(self, value: Any) -> str | None:
        """A sender returns messages."""
        if isinstance(value, Iterable) and all(isinstance(each, Message) for each in value):
            return None
        return f"`_compute` returned {_described(value)}: a sender returns the messages to send, a list of Message"

    def _update(self, value: Iterable[Message]) -> None:
        for message in value:
            self.send(message)


class CommunicationReceiver(Component):
    """Receives messages of other agents; `_update` is called with those that arrived, oldest first."""

    @property
    def kinds(self) -> Collection[str] | None:
        """The kinds of messages that it reads; other components get these only if they ask for them as well.

        None for all kinds that no component asks for.
        """
        return None

    def _compute(self) -> Any:
        return self._surroundings.exchange.receive(self._agent.id, self._reader)

    @property
    def _reader(self) -> str:
        return "" if self.kinds is None else self.name

    def messages(self) -> Wait:
        """Wait for messages within a turn of the asynchronous mode: ``heard = await self.messages()``.

        The result is all unread messages, oldest first, including those that arrived before the call.
        """
        return MessageWait(self._agent.id, self._reader)

    @abstractmethod
    def _update(self, value: Sequence[Message]) -> None:
        """Process the messages that arrived."""


class Controller(Component):
    """Chooses the control input; `_compute` returns it, shape (nu,), with the intent, a `TimeSeries`.

    A class with its own `_update` may return more.
    """

    @abstractmethod
    def _compute(self) -> tuple[Any, ...]:
        """Return the control input and the intent."""

    def misfit(self, value: Any) -> str | None:
        """A controller returns a control input and an intent."""
        quantities = self._agent.group.model.control_input
        wanted = (
            f"its control input, {len(quantities)} numbers ({', '.join(each.name for each in quantities)}), and its"
        )
        expected = f"a controller returns {wanted} intent, a TimeSeries, as in `return control_input, TimeSeries()`"
        if not isinstance(value, tuple) or len(value) != 2 or not isinstance(value[1], TimeSeries):
            return f"`_compute` returned {_described(value)}: {expected}"
        try:
            control_input = real(value[0])
        except (TypeError, ValueError) as error:
            return f"the control input that `_compute` returned is no vector, {error}: {expected}"
        if control_input.shape != (len(quantities),):
            return f"`_compute` returned a control input of shape {control_input.shape}: {expected}"
        return None

    def _update(self, value: tuple[Any, ...]) -> None:
        control_input, intent = value
        self._agent.model.control_input = control_input
        self._agent.self_awareness.intent = intent


def _described(value: Any) -> str:
    """Return a short description of a value."""
    if value is None:
        return "nothing (None)"
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if isinstance(value, tuple):
        return f"({', '.join(type(each).__name__ for each in value)})"
    kind = type(value).__name__
    return f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"
