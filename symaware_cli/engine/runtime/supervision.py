"""Supervision of a component entry: suspended agents, disturbances by faults, and latencies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, ClassVar

from symaware_cli.core import AgentGroup, GroupComponent
from symaware_cli.engine.runtime.held_rows import HeldRows
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.world import LONGEST, Turn, fraction, nanoseconds

if TYPE_CHECKING:
    from symaware_cli.world import ProbabilityDistribution

_NONE = nullcontext()

#: Changes written values, given the group and the rows whose believed states were written in the turn.
Disturb = Callable[[AgentGroup, Sequence[int]], None]


class Supervision:
    """The effects of faults, absence and other processes on the turns of one entry.

    Attributes:
        suspended: The number of reasons for which each suspended agent is suspended, by row.
        remote: The rows of the agents that run in another process, which is one such reason.
        disturbances: Functions called after each turn.
    """

    uncaptured: ClassVar[Collection[str]] = ("_muted",)

    def __init__(self, simulation: Simulation, entry: ComponentEntry, changed: Callable[[], object]) -> None:
        """Prepare.

        Args:
            simulation: The simulation.
            entry: The supervised entry.
            changed: Called when `interferes` or `slows_down` may have changed.
        """
        self.suspended: Counter[int] = Counter()
        self.remote: set[int] = set()
        self.disturbances: list[Disturb] = []
        self._simulation = simulation
        self._entry = entry
        self._is_group = isinstance(entry.components[0], GroupComponent)
        #: The latencies that faults impose on each row, with their counts.
        self._slowness: dict[int, Counter[ProbabilityDistribution]] = {}
        self._changed = changed
        #: What `held` returned last.
        self._muted: HeldRows | None = None

    @property
    def interferes(self) -> bool:
        """Whether agents are suspended or disturbed."""
        return bool(self.suspended or self.disturbances)

    @property
    def slows_down(self) -> bool:
        """Whether faults change the latency of some computations."""
        return bool(self._slowness)

    def suspends(self, row: int) -> bool:
        """Whether the component of a row takes no turns, as all its agents are suspended."""
        if not self._is_group:
            return row in self.suspended
        if len(self.suspended) < len(self._entry.group) or len(self.remote) == len(self.suspended):
            return len(self.suspended) == len(self._entry.group)
        # Other agents of the group run in another process; the component must keep the same state and draws here.
        return all(reasons > (agent in self.remote) for agent, reasons in self.suspended.items())

    def held(self) -> HeldRows | None:
        """The context for turns of a group component, some of whose agents are suspended; None if there are none."""
        rows = tuple(sorted(self.suspended)) if self._is_group else ()
        if rows and (self._muted is None or self._muted.rows != rows):
            self._muted = self._simulation.holding(self._entry, rows)
        return self._muted if rows else None

    def hold(self, agent: int) -> None:
        """Add a reason to suspend an agent."""
        self.suspended[agent] += 1
        self._changed()

    def release(self, agent: int) -> None:
        """Remove a reason to suspend an agent."""
        self.suspended[agent] -= 1
        if self.suspended[agent] <= 0:
            del self.suspended[agent]
        self._changed()

    def add_disturbance(self, disturbance: Disturb) -> None:
        """Add a function to call after each turn; see `Disturb`."""
        self.disturbances.append(disturbance)
        self._changed()

    def remove_disturbance(self, disturbance: Disturb) -> None:
        """Remove a function added by `add_disturbance`."""
        self.disturbances.remove(disturbance)
        self._changed()

    def slow_down(self, agents: Sequence[int], duration: ProbabilityDistribution) -> None:
        """Impose a latency on the computations for some agents, instead of that of the scenario."""
        for row in self._rows(agents):
            self._slowness.setdefault(row, Counter())[duration] += 1
        self._changed()

    def speed_up(self, agents: Sequence[int], duration: ProbabilityDistribution) -> None:
        """Undo one call of `slow_down`."""
        for row in self._rows(agents):
            self._slowness[row] -= Counter([duration])
            if not self._slowness[row]:
                del self._slowness[row]
        self._changed()

    def _rows(self, agents: Sequence[int]) -> Sequence[int]:
        """The rows of the components of some agents."""
        return [0] if self._is_group else agents

    def latency(self, row: int, turn: Turn) -> int:
        """The latency of a component's computation in a turn, in nanoseconds."""
        durations, drawn = self._slowness.get(row) or (self._entry.timing.latency,), 0.5
        if any(duration.is_drawn for duration in durations):
            # One draw for all imposed latencies, so that faults do not change other draws.
            drawn = fraction(self._simulation.seed, self._entry.components[row].path, "latency", *turn)
        return max(nanoseconds(min(duration.quantile(drawn), LONGEST)) for duration in durations)

    def supervised(self) -> AbstractContextManager[None]:
        """A context for a turn: on exit, the rows of suspended agents are restored and disturbances are applied."""
        return self._supervise() if self.interferes else _NONE

    @contextmanager
    def _supervise(self) -> Iterator[None]:
        group, held = self._entry.group, self.held()
        column = group.awareness.state_column
        earlier = column.take_changes() if self.disturbances else ()
        with held or _NONE:
            yield
        if not self.disturbances:
            return
        written = column.take_changes()
        rows = [
            row for row in (range(len(group)) if written is None else written) if held is None or row not in held.rows
        ]
        for changed in (earlier, written):
            column.mark(changed)
        for disturbance in self.disturbances:
            disturbance(group, rows)
