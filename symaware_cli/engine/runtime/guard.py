"""Guards calls into the components of one entry: checks the values that they write, and handles failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from symaware_cli.awareness import NotFiniteError
from symaware_cli.core import AgentGroup, Component, GroupComponent, Level, SubscriberError
from symaware_cli.engine.runtime.failure import RunError, describe
from symaware_cli.engine.runtime.finiteness import FinitenessCheck
from symaware_cli.engine.runtime.interruption import Interrupted, Interruption
from symaware_cli.engine.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.engine.runtime.supervision import Supervision
from symaware_cli.engine.runtime.timing import Coast

#: The result of a call that failed.
FAILED = object()

#: Takes agents of a group out of a run, with a choice of their further control input, and a reason.
Isolate = Callable[[AgentGroup, Sequence[int], Coast, str], object]


class Guard:
    """Calls components with signals enabled, checks the values that they write, and applies `on_failure`.

    Attributes:
        supervision: Suspended agents, and the effects of faults on the other agents.
        failures: The number of failures that did not end the run.
        tries: The number of restarts of each component after failures, by row.
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
            simulation: The simulation.
            entry: The entry whose components are called.
            supervision: See `Guard`.
            interruption: Defers signals.
            isolate: See `Isolate`.
            restart: Restarts the component of a row.
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
        self._finiteness = FinitenessCheck(entry.group, entry.path, entry.use)

    def attempt(self, row: int, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call a method of a component with signals enabled; handle an exception as a failure and return `FAILED`."""
        self._interruption.unshield()
        try:
            return call(*arguments)
        except (SubscriberError, Interrupted):
            raise
        except BaseException as error:
            self.handle_failure(row, self.failure(self._entry.components[row], describe(error), error))
            return FAILED
        finally:
            self._interruption.shield()

    def failure(
        self, component: Component | GroupComponent, problem: str, cause: BaseException | None = None
    ) -> RunError:
        """Create the error of a component that failed, or of the one whose deferred series it could not read."""
        if isinstance(cause, NotFiniteError):
            return RunError(cause.path, cause.use, self._simulation.clock.now, str(cause), cause)
        return RunError(component.path, self._entry.use, self._simulation.clock.now, problem, cause)

    def handle_failure(self, row: int, failure: RunError, agents: Sequence[int] | None = None) -> None:
        """Handle a failure as `on_failure` in the scenario requires.

        Args:
            row: The component's row.
            failure: The failure.
            agents: The rows of the agents concerned; None for all agents of the component.

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
        all_rows = self._entry.rows or range(len(self._group)) if self._is_group else [row]
        self._isolate(self._group, all_rows if agents is None else agents, timing.coast, "a component failed")

    def snapshot(self) -> Sequence[Any] | None:
        """Return the present values, to be restored if values that are not finite are written."""
        return None if self._entry.timing.on_failure == "stop" else self._finiteness.snapshot()

    def clear(self, rows: Sequence[int]) -> None:
        """Empty the parts of awareness and the signals of some agents that the components wrote."""
        self._finiteness.clear(rows)

    def check(self, before: Sequence[Any] | None) -> None:
        """Check that the values written are finite and bounded.

        Args:
            before: The result of `snapshot`.

        Raises:
            RunError: A value is not, and that ends the run.
        """
        if before is None and self._finiteness.passes():
            return
        ids, name, now = self._group.ids, self._entry.name, self._simulation.clock.now
        for rows, problem in self._finiteness.violations(before):
            others = f", and so for {len(rows) - 1} more agents" if len(rows) > 1 else ""
            failure = RunError(f"agents.{ids[rows[0]]}.{name}", self._entry.use, now, problem + others)
            if before is None:
                raise failure
            if self._is_group:
                self.handle_failure(0, failure, rows)
                continue
            for row in rows:
                path = f"agents.{ids[row]}.{name}"
                self.handle_failure(row, RunError(path, self._entry.use, now, problem.partition(":")[0]))
