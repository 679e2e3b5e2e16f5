"""Keeps a group component from acting for some of its agents."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symaware_cli.core import AgentGroup, EventBus, Roster
from symaware_cli.engine.network.exchange import MessageExchange
from symaware_cli.engine.runtime.protected_rows import ProtectedRows


class HeldRows:
    """A context for the turns of a group component some of whose agents are suspended, or use another one.

    The component works on arrays with a row for each agent, so it sends messages, fires events and writes values for
    these agents, too: within the context, the former are suppressed; at its end, the latter are restored.

    Attributes:
        rows: The rows of these agents, ascending.
    """

    def __init__(
        self,
        group: AgentGroup,
        name: str,
        rows: Sequence[int],
        roster: Roster,
        exchange: MessageExchange,
        events: EventBus,
    ) -> None:
        """Prepare.

        Args:
            group: The group of the component.
            name: Its name.
            rows: See `HeldRows`.
            roster: All agents.
            exchange: Carries its messages.
            events: Takes its events.
        """
        ids = [group.ids[row] for row in rows]
        self.rows = tuple(rows)
        self._exchange, self._events = exchange, events
        self._senders = np.zeros(len(roster), bool)
        self._senders[[roster.index(id) for id in ids]] = True
        self._sources = frozenset(f"agents.{id}.{name}" for id in ids)
        self._protected = ProtectedRows(group, rows)

    def __enter__(self) -> None:
        self._protected.__enter__()
        self._exchange.mute(self._senders)
        self._events.mute(self._sources)

    def __exit__(self, kind: object, *error: object) -> None:
        self._events.mute(())
        self._exchange.mute(None)
        self._protected.__exit__(kind, *error)
