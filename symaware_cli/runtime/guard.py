"""Calls into the components of one entry, and what becomes of their failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from symaware_cli.awareness.column import Array
from symaware_cli.core import AgentGroup, Component, GroupComponent, Level, SubscriberError
from symaware_cli.runtime.failure import RunError, describe
from symaware_cli.runtime.finiteness import FinitenessCheck
from symaware_cli.runtime.interruption import Interrupted, Interruption
from symaware_cli.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.runtime.supervision import Supervision
from symaware_cli.runtime.timing import Coast

#: What stands for the value of a call that failed.
FAILED = object()

#: Takes agents of a group out of a run, with their control input from now on, and why.
Isolate = Callable[[AgentGroup, Sequence[int], Coast, str], object]


class Guard:
    """Calls components with signals let through, looks at what they write, and does what is said `on_failure`.

    Attributes:
        supervision: Who takes no part at present, and what faults make of the others.
        failures: How many failed without ending the run.
        tries: How often each component began anew after a failure, by row.
    """

    def __init__(
        self,
        simulation: Simulation,
        entry: ComponentEntry,
        supervision: Supervision,
        interruption: Interruption,
        isolate: Isolate,
        restart: Callable[[int], object],
    ) -> None:
        """Prepare.

        Args:
            simulation: What runs.
            entry: Whose components are called.
            supervision: See there.
            interruption: Holds signals back.
            isolate: See `Isolate`.
            restart: Lets the component of a row begin anew.
        """
        self.supervision = supervision
        self.failures = 0
        self.tries: Counter[int] = Counter()
        self._simulation = simulation
        self._entry = entry
        self._group = entry.group
        self._is_group = isinstance(entry.components[0], GroupComponent)
        self._interruption = interruption
        self._isolate = isolate
        self._restart = restart
        self._finiteness = FinitenessCheck(entry.group)

    def attempt(self, row: int, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call something of a component, with signals let through; `FAILED` where it raised, which is its failure."""
        self._interruption.unshield()
        try:
            return call(*arguments)
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            self.fail(row, self.failure(self._entry.components[row], describe(error), error))
            return FAILED
        finally:
            self._interruption.shield()

    def failure(
        self, component: Component | GroupComponent, problem: str, cause: BaseException | None = None
    ) -> RunError:
        """What to say of a component that failed."""
        return RunError(component.path, self._entry.use, self._simulation.clock.now, problem, cause)

    def fail(self, row: int, failure: RunError, agents: Sequence[int] | None = None) -> None:
        """Do what the scenario says about a component that failed.

        Args:
            row: The component's row.
            failure: What happened.
            agents: The rows of the agents concerned, where those are not all that the component serves.

        Raises:
            RunError: The failure ends the run.
        """
        timing = self._entry.timing
        if timing.on_failure == "stop" or (timing.on_failure == "restart" and self.tries[row] >= timing.tries):
            raise failure
        self.failures += 1
        self._simulation.announce("failed", failure.source, str(failure), level=Level.WARNING, **failure.data)
        if timing.on_failure == "restart":
            self.tries[row] += 1
            self._restart(row)
            return
        everybody = range(len(self._group)) if self._is_group else [row]
        self._isolate(self._group, everybody if agents is None else agents, timing.coast, "a component failed")

    def present(self) -> Sequence[Array] | None:
        """What stands in the columns, to go back to if it is overwritten with what is not finite."""
        return None if self._entry.timing.on_failure == "stop" else self._finiteness.present()

    def check(self, before: Sequence[Array] | None) -> None:
        """Look for what is not finite in what was written.

        Raises:
            RunError: Something is not, and that ends the run.
        """
        if not self._finiteness.is_due:
            return
        ids, name, now = self._group.ids, self._entry.name, self._simulation.clock.now
        for rows, problem in self._finiteness.offences(before):
            others = f", and so for {len(rows) - 1} more agents" if len(rows) > 1 else ""
            failure = RunError(f"agents.{ids[rows[0]]}.{name}", self._entry.use, now, problem + others)
            if before is None:
                raise failure
            if self._is_group:
                self.fail(0, failure, rows)
                continue
            for row in rows:
                path = f"agents.{ids[row]}.{name}"
                self.fail(row, RunError(path, self._entry.use, now, problem.partition(":")[0]))
