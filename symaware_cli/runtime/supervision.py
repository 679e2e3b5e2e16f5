"""The supervision of a component: which agents it must leave alone, what disturbs it, and how long it takes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext

from symaware_cli.core import AgentGroup, GroupComponent
from symaware_cli.runtime.protected_rows import protected
from symaware_cli.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.runtime.timing import Duration
from symaware_cli.world.chance import Turn, fraction

_NONE = nullcontext()

#: Changes what was written, given the group and the rows of the believed states that were written in the turn.
Disturb = Callable[[AgentGroup, Sequence[int]], None]


class Supervision:
    """What stands between the components of one entry and what they do.

    Attributes:
        off: Agents that take no part here at present, with how many reasons there are for it.
        away: Those of them that run in another process, which is one of the reasons.
        disturbances: What is called after each turn.
    """

    def __init__(self, simulation: Simulation, entry: ComponentEntry, changed: Callable[[], object]) -> None:
        """Prepare.

        Args:
            simulation: What runs.
            entry: Whose supervision it is.
            changed: Called when what `interferes` or `slows_down` says may be different.
        """
        self.off: Counter[int] = Counter()
        self.away: set[int] = set()
        self.disturbances: list[Disturb] = []
        self._simulation = simulation
        self._entry = entry
        self._is_group = isinstance(entry.components[0], GroupComponent)
        #: What faults say that computations of a row take, each as often as it was said.
        self._slowness: dict[int, Counter[Duration]] = {}
        self._changed = changed

    @property
    def interferes(self) -> bool:
        """Whether a turn is anything but what the component makes of it."""
        return bool(self.off or self.disturbances)

    @property
    def slows_down(self) -> bool:
        """Whether some computations take another time than the scenario says for the component."""
        return bool(self._slowness)

    def keeps_off(self, row: int) -> bool:
        """Whether the component of a row takes no turn, as nobody whom it serves takes part."""
        if not self._is_group:
            return row in self.off
        if len(self.off) < len(self._entry.group) or len(self.away) == len(self.off):
            return len(self.off) == len(self._entry.group)
        # Others of the group take part elsewhere. What it remembers and draws here must not fall behind.
        return all(reasons > (agent in self.away) for agent, reasons in self.off.items())

    def hold(self, agent: int) -> None:
        """There is a reason more against an agent."""
        self.off[agent] += 1
        self._changed()

    def release(self, agent: int) -> None:
        """There is a reason less against an agent."""
        self.off[agent] -= 1
        if self.off[agent] <= 0:
            del self.off[agent]
        self._changed()

    def disturb(self, disturbance: Disturb) -> None:
        """Call something after each turn, with the group and the rows of the believed states that it wrote."""
        self.disturbances.append(disturbance)
        self._changed()

    def undisturb(self, disturbance: Disturb) -> None:
        """Call it no more."""
        self.disturbances.remove(disturbance)
        self._changed()

    def slow_down(self, agents: Sequence[int], duration: Duration) -> None:
        """Let computations for some agents take at least a time, instead of the one that the scenario says."""
        for row in self._rows(agents):
            self._slowness.setdefault(row, Counter())[duration] += 1
        self._changed()

    def speed_up(self, agents: Sequence[int], duration: Duration) -> None:
        """Take back, once, that computations for some agents take a time."""
        for row in self._rows(agents):
            self._slowness[row] -= Counter([duration])
            if not self._slowness[row]:
                del self._slowness[row]
        self._changed()

    def _rows(self, agents: Sequence[int]) -> Sequence[int]:
        """The rows of the components of some agents."""
        return [0] if self._is_group else agents

    def latency(self, row: int, turn: Turn) -> int:
        """How long the computation of a component takes in a turn, in nanoseconds."""
        durations, drawn = self._slowness.get(row) or (self._entry.timing.latency,), 0.5
        if any(duration.is_drawn for duration in durations):
            # One draw for all that make it slow, so that faults do not change what is drawn for others.
            drawn = fraction(self._simulation.seed, self._entry.components[row].path, "latency", *turn)
        return max(duration.at(drawn) for duration in durations)

    def watched(self) -> AbstractContextManager[None]:
        """Put back what must not change of what is written, and let faults have their way with the rest."""
        return self._watch() if self.interferes else _NONE

    @contextmanager
    def _watch(self) -> Iterator[None]:
        group = self._entry.group
        column = group.awareness.state_column
        earlier = column.take_changes() if self.disturbances else ()
        # A component of the whole group speaks and writes for all its agents.
        held = sorted(self.off) if self._is_group else ()
        simulation, muted = self._simulation, [group.ids[row] for row in held]
        sources = frozenset(f"agents.{id}.{self._entry.name}" for id in muted)
        with protected(group, held), simulation.exchange.muted(muted), simulation.events.muted(sources):
            yield
        if not self.disturbances:
            return
        written = column.take_changes()
        rows = [row for row in (range(len(group)) if written is None else written) if row not in held]
        for changed in (earlier, written):
            column.mark(changed)
        for disturbance in self.disturbances:
            disturbance(group, rows)
