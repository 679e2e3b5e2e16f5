"""The host's records of its members, and the control inputs of the agents that they run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from symaware_cli.awareness import Array, Column
from symaware_cli.core import AgentGroup, Delivery
from symaware_cli.core.message import Indices
from symaware_cli.engine import FrameError, Simulation, safe_input
from symaware_cli.processes.participant import rows_of
from symaware_cli.processes.sent_frames import RepeatedFrames, SentFrames
from symaware_cli.world import is_finite


@dataclass(slots=True)
class RemoteMember:
    """A member that takes part in the run.

    Attributes:
        peer: Its number at the port.
        name: Its name.
        agents: The ids of its agents, in the order of the roster.
        is_here: For each agent of the roster, whether this member runs it.
        rank: The roster index of its first agent; members are served in this order.
        reported: The last step for which it sent a report.
        arrived: Messages for its agents that have not been sent to it yet.
        sent: The frames since its last checkpoint; None if the run ends when its process dies.
        repeated: The frames to send again, as it continues from its checkpoint, and the frames after them.
        absent: The first step that its agents miss, as its process died and the run goes on; None if they take part.
        repeats: The last step that it repeats: the host has received its report for this one and all before.
        heard: The last step for which it sent a report through its present connection.
    """

    peer: int
    name: str
    agents: tuple[str, ...]
    is_here: NDArray[np.bool_]
    rank: int
    reported: int
    arrived: list[Delivery] = field(default_factory=list)
    sent: SentFrames | None = None
    repeated: RepeatedFrames = field(default_factory=RepeatedFrames)
    absent: int | None = None
    repeats: int = -1
    heard: int = -1

    def owns(self, indices: Indices, numbers: Indices, count: int) -> bool:
        """Whether received numbers are in range, and this member runs all agents that they denote.

        Args:
            indices: The roster indices of these agents.
            numbers: The received numbers.
            count: The number of valid values.
        """
        return bool(((numbers >= 0) & (numbers < count)).all() and self.is_here[indices].all())


@dataclass(slots=True)
class _Latest:
    """The latest control inputs of those agents of a group that run in other processes.

    Attributes:
        group: The group.
        rows: Their rows, ascending; shape (m,).
        values: Their control inputs; shape (m, nu).
        member: The member whose last report passed the check of ownership.
        told: The rows of that report.
        places: Where these are among `rows`.
    """

    group: AgentGroup
    rows: Indices
    values: Array
    member: RemoteMember | None = None
    told: Indices | None = None
    places: slice | Indices = field(default_factory=lambda: slice(None))

    def place(self, rows: Indices) -> slice | Indices:
        """Where some of the rows are."""
        return slice(None) if np.array_equal(rows, self.rows) else np.searchsorted(self.rows, rows)

    def replace(self, places: slice | Indices, values: Array) -> None:
        """Replace the control inputs of some rows."""
        latest = self.values.copy()
        latest[places] = values
        latest.flags.writeable = False
        self.values = latest


class RemoteInputs:
    """The latest control input of each agent that runs in another process, under which the world moves."""

    def __init__(self, simulation: Simulation, away: Iterable[str]) -> None:
        """Start with the present control inputs of the agents.

        Args:
            simulation: The simulation.
            away: The ids of the agents that run in other processes.
        """
        self._simulation = simulation
        everybody = frozenset(away)
        self._latest: dict[str, _Latest] = {}
        for group in simulation.groups:
            rows = rows_of(group, everybody)
            if len(rows):
                self._latest[group.name] = _Latest(group, rows, group.control_input[rows])

    def take(self, member: RemoteMember, name: str, rows: Indices, values: Array) -> None:
        """Store the control inputs that a member reports for a group.

        Args:
            member: The member.
            name: The group's name.
            rows: The rows of the agents, ascending; shape (m,).
            values: The control inputs; shape (m, nu).

        Raises:
            FrameError: There is no such group, or rows or values are invalid.
        """
        latest = self._latest.get(name)
        if latest is None or values.shape != (len(rows), latest.values.shape[1]) or not is_finite(values):
            raise FrameError(f"control inputs of `{name}` that cannot be")
        # Usually the same array in each step.
        if latest.member is not member or latest.told is not rows:
            first = self._simulation.environment.roster.start(name)
            if not member.owns(first + rows, rows, len(latest.group)):
                raise FrameError(f"control inputs of agents of `{name}` that are not its own")
            latest.member, latest.told, latest.places = member, rows, latest.place(rows)
        latest.replace(latest.places, values)

    def slow_down(self, group: AgentGroup, rows: Indices) -> None:
        """Replace the control inputs of agents by those with which they stop as far as they can."""
        latest, state = self._latest[group.name], self._simulation.environment.state(group)
        for row in rows.tolist():
            place = int(np.searchsorted(latest.rows, row))
            own = latest.values[place : place + 1]
            slowest = safe_input(group.model, own, state[row : row + 1])
            latest.replace(slice(place, place + 1), slowest.reshape(own.shape))

    def exchange(self) -> list[tuple[Column, Array]]:
        """Put the control inputs in force; returns what `restore` takes."""
        present = []
        for latest in self._latest.values():
            column, values = latest.group.control_column, latest.values
            if len(latest.rows) < len(latest.group):
                values = column.values.copy()
                values[latest.rows] = latest.values
            present.append((column, column.exchange(values)))
        return present

    @staticmethod
    def restore(present: Iterable[tuple[Column, Array]]) -> None:
        """Restore the control inputs that components of this process wrote."""
        for column, values in present:
            column.exchange(values)
