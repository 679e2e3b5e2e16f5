"""A simulation that the caller steps, observes and controls."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from symaware_cli.api.report import TextReport
from symaware_cli.api.result import RunResult, result_of
from symaware_cli.engine import SimulationState, StateMark, capture, mark, restore, return_to
from symaware_cli.language import nearest, prepared
from symaware_cli.version import __version__
from symaware_cli.world import counted, frozen, is_finite

if TYPE_CHECKING:
    from symaware_cli.core import AgentGroup, Event, Quantity
    from symaware_cli.core.event import Subscription
    from symaware_cli.language.build import Built

Array = NDArray[np.float64]


class SteppedSimulation:
    """A simulation between two steps; made by `Scenario.start`.

    In a step all components take their turns at the present instant, then the world moves by one time step, as in any
    run: a simulation that is stepped to its end writes the same log as `Scenario.run`. Leaving the ``with`` block
    before that ends the run as interrupted, with its log finished. Ctrl-C within a step ends it as well; between two
    steps the caller has to handle it.
    """

    def __init__(self, built: Built, log: Path | None, within_steps: bool = False) -> None:
        """Initialise the components.

        Args:
            built: The simulation to run; it cannot be run twice.
            log: The path of the log, or None for no log.
            within_steps: See `Scenario.start`.

        Raises:
            RunFailedError: A component failed.
            LogError: The log cannot be written.
        """
        self._simulation = built.simulation
        self._steps = built.steps
        self._built = built
        self._events: list[Event] = []
        simulation = built.simulation
        self._rows = {id: (group, row) for group in simulation.groups for row, id in enumerate(group.ids)}
        self._named = {group.name: group for group in simulation.groups}
        simulation.events.subscribe("*", self._events.append)
        self._stack = ExitStack()
        self._run = self._stack.enter_context(prepared(built, log, may_exit=False))
        self._run.kernel.yields_within_steps = within_steps
        try:
            self._advance(0)
        except BaseException:
            self._stack.close()
            raise

    def step(self, count: int = 1) -> int:
        """Make steps; fewer if the run ends before.

        Args:
            count: The number of steps, at least 1.

        Returns:
            The number of steps that were made. It may be 0 if the run ends because its ``until`` holds.

        Raises:
            RuntimeError: The run is over already.
            RunFailedError: A component or the environment failed.
            RunInterrupted: Ctrl-C or SIGTERM ended the run within the step.
            LogError: The log cannot be written.
        """
        if count < 1:
            raise ValueError(f"a number of steps is at least 1, not {count}")
        if self.done:
            raise RuntimeError(f"the run of {self._simulation.name} is over: {self._run.status}")
        before = self._run.done
        self._advance(count)
        return self._run.done - before

    def finish(self) -> RunResult:
        """Make all remaining steps, and return the result of the run; raises the same exceptions as `step`."""
        if not self.done:
            self._advance(None)
        return self.result

    def _advance(self, steps: int | None) -> None:
        self._events.clear()
        self._run.advance(steps)
        if self.done:
            result_of(self._run)

    @property
    def done(self) -> bool:
        """Whether the run is over."""
        return self._run.status is not None

    @property
    def now(self) -> int:
        """Simulated time [ns]."""
        return self._simulation.clock.now

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._simulation.clock.now / 1e9

    @property
    def steps(self) -> int:
        """The number of steps that were made."""
        return self._run.done

    @property
    def groups(self) -> Mapping[str, Sequence[str]]:
        """The ids of the agents of each group, in the order of rows."""
        return {name: group.ids for name, group in self._named.items()}

    @property
    def events(self) -> Sequence[Event]:
        """The events of the last call of `step`; before the first call, those since the start.

        Events of every step, turn or message are not included.
        """
        return tuple(self._events)

    @property
    def result(self) -> RunResult:
        """The result of the run.

        Raises:
            RuntimeError: The run is not over.
        """
        if not self.done:
            raise RuntimeError(f"the run of {self._simulation.name} goes on")
        return RunResult(self._run.summary)

    def state(self, name: str, *columns: str) -> Array:
        """The true state of a group or an agent.

        Args:
            name: A group or an agent. The name of a group without a count is that of its agent.
            columns: The names of columns to return; by default all, in the order of `state_columns`.

        Returns:
            Read-only; shape (n, columns) for a group, (columns,) for an agent.

        Raises:
            KeyError: There is no such name or column.
        """
        group, row = self._find(name)
        return _part(self._simulation.environment.state(group), row, group.model.state, columns)

    def belief(self, name: str, *columns: str) -> Array:
        """The belief of agents of their own state; see `state`."""
        group, row = self._find(name)
        return _part(group.awareness.state, row, group.model.state, columns)

    def awareness(self, name: str, part: str, *columns: str) -> Array:
        """A part of the agents' awareness of themselves, such as ``risk``, or a signal of a component; see `state`.

        A signal is called by its component and its name, such as ``steer.barrier``. For a series, this is the first
        point. Values that were never written are NaN.
        """
        group, row = self._find(name)
        known = {**group.awareness.parts, **group.awareness.signals}
        column, declared = group.awareness.columns.get(part), known.get(part)
        if column is None or declared is None or declared.kind == "table":
            kinds = [each for each, of in known.items() if of.kind != "table" and each in group.awareness.columns]
            raise KeyError(_unknown("part of awareness", part, kinds))
        values = np.array([column.present(each) for each in range(len(group))])
        return _part(values, row, declared.columns or (), columns)

    def control(self, name: str, *columns: str) -> Array:
        """The last requested control input; see `state`, with the columns of `control_columns`."""
        group, row = self._find(name)
        return _part(group.control_input, row, group.model.control_input, columns)

    def state_columns(self, name: str) -> tuple[str, ...]:
        """The names of the elements of a state of a group or an agent."""
        return tuple(quantity.name for quantity in self._find(name)[0].model.state)

    def control_columns(self, name: str) -> tuple[str, ...]:
        """The names of the elements of a control input of a group or an agent."""
        return tuple(quantity.name for quantity in self._find(name)[0].model.control_input)

    def set_control(self, name: str, values: ArrayLike | None) -> None:
        """Override the control input of a group or an agent, from the next step on.

        The values replace those that the components request, and the inputs of agents that a failure or a fault has
        taken out of the run, until other values or None are set. The components keep running. The model saturates the
        values like any request; the log has both, as ``requested_control`` and ``applied_control``.

        Args:
            name: A group, or an agent.
            values: Shape (n, nu) for a group, or (nu,) for all of its agents; (nu,) for an agent. None returns control
                to the components.

        Raises:
            KeyError: There is no such name.
            TypeError: The values are not real numbers.
            ValueError: They do not have that shape, or are not finite.
        """
        group, row = self._find(name)
        chosen = np.zeros(len(group), bool)
        chosen[slice(None) if row is None else row] = True
        rows, held = self._run.imposed.get(group, (np.zeros(len(group), bool), np.zeros_like(group.control_input)))
        if values is None:
            rows = rows & ~chosen
        else:
            held = held.copy()
            held[chosen] = self._control_input(name, group, row, values)
            rows = rows | chosen
        if rows.any():
            self._run.imposed[group] = rows, held
        else:
            self._run.imposed.pop(group, None)

    def _control_input(self, name: str, group: AgentGroup, row: int | None, values: ArrayLike) -> Array:
        given = frozen(values)
        one = group.control_input.shape[1:]
        shapes = [one] if row is not None else [group.control_input.shape, one]
        if given.shape not in shapes:
            columns = ", ".join(self.control_columns(name))
            expected = " or ".join(str(shape) for shape in shapes)
            raise ValueError(f"the control input of {name} ({columns}) has shape {expected}, not {given.shape}")
        if not is_finite(given):
            raise ValueError(f"the control input of {name} is not finite: {given.tolist()}")
        return given

    def _find(self, name: str) -> tuple[AgentGroup, int | None]:
        """Return the group that a name refers to, and the row if it is that of an agent."""
        if name in self._rows:
            return self._rows[name]
        if name in self._named:
            return self._named[name], None
        raise KeyError(_unknown("group or agent", name, [*self._named, *self._rows]))

    def subscribe(self, pattern: str, call: Callable[[Event], object], source: str = "*") -> Subscription:
        """Call a function at events from now on; without subscribers, events of turns, steps and messages cost nothing.

        Args:
            pattern: The event's name, such as ``computed``, in which ``*`` matches anything.
            call: Called with the `Event`, which has its agent, component and value.
            source: The path of its source, such as ``agents.robot.*``, in which ``*`` matches anything.

        Returns:
            The subscription, which can be cancelled with ``cancel()``.
        """
        return self._simulation.events.subscribe_matching(pattern, call, source)

    @cached_property
    def _digest(self) -> str:
        """The SHA-256 of the scenario, which only captured states need."""
        return hashlib.sha256(self._built.resolved).hexdigest()

    def capture(self) -> SimulationState:
        """Capture the state of the simulation, to `restore` it here or in another process with the same scenario.

        Raises:
            StateError: The run is over, or something cannot be captured, such as a turn that waits; the message names
                it.
            LogError: The log cannot be written.
        """
        return capture(self._run, self._digest, __version__)

    def restore(self, state: SimulationState, seed: int | None = None) -> None:
        """Restore a state of this simulation, or of another one of the same scenario.

        It continues in the same way as that one, including the log, message by message. If the state was captured while
        the present log was written, later entries are removed from the log. A simulation without a log can be restored
        after its end as well.

        Args:
            state: The result of `capture` or `SimulationState.from_bytes`.
            seed: What everything random is drawn from thereafter; by default from the seed of the state, as if nothing
                had been restored. Generators that a component made for itself continue as captured.

        Raises:
            StateError: The state is one of another scenario, seed or version, or cannot be restored here; the message
                gives the reason. Nothing was changed.
            LogError: The log cannot be written.
        """
        restore(self._run, state, self._digest, __version__, seed)
        self._events.clear()

    def mark(self) -> StateMark:
        """Mark the present state, to return to it in this simulation many times.

        This is a hundred times faster than `capture` and `restore`, which serve other processes as well. The simulation
        has no log, and is between two steps.

        Raises:
            StateError: The state cannot be captured, or the simulation cannot continue once it is over.
        """
        return mark(self._run)

    def go_back(self, marked: StateMark, seed: int | None = None) -> None:
        """Return to a marked state of this simulation, also after its end or from within a step.

        Args:
            marked: The result of `mark`.
            seed: See `restore`.
        """
        return_to(self._run, marked, seed)
        self._events.clear()

    def close(self) -> None:
        """End the run if it is not over, and finish its log; closing it twice has no effect."""
        self._leave("ended between two steps")

    def _leave(self, reason: str) -> None:
        with self._stack:
            self._run.leave(reason)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._leave(f"ended between two steps by {kind.__name__}" if kind else "ended between two steps")

    @property
    def _report(self) -> TextReport:
        headline = (
            f"{self._simulation.name}: {self._run.status or 'stands'} at {self.time:g} s, step {self.steps:,} of "
        )
        facts = []
        for name, group in self._named.items():
            imposed = self._run.imposed.get(group)
            outside = f", {int(imposed[0].sum())} controlled from outside" if imposed else ""
            columns = ", ".join(str(quantity) for quantity in self.state_columns(group.ids[0]))
            facts.append((name, f"{counted(len(group), 'agent')}{outside}; state: {columns}"))
        return TextReport(f"{headline}{self._steps:,}", facts)

    def __repr__(self) -> str:
        return f"<SteppedSimulation {self._report.headline}>"

    def __str__(self) -> str:
        return self._report.text

    def _repr_html_(self) -> str:
        return self._report.html


def _part(values: Array, row: int | None, quantities: Sequence[Quantity], columns: Sequence[str]) -> Array:
    """Return some columns of a row, or of all rows, read-only."""
    values = values if row is None else values[row]
    if not columns:
        return frozen(values)
    names = [quantity.name for quantity in quantities]
    unknown = next((name for name in columns if name not in names), None)
    if unknown is not None:
        raise KeyError(_unknown("column", unknown, names))
    return frozen(values[..., [names.index(name) for name in columns]])


def _unknown(what: str, name: str, known: Sequence[str]) -> str:
    near = nearest(name, known)
    return f"there is no {what} {name!r}" + (f"; did you mean {near!r}?" if near else "")
