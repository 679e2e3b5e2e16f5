"""Specifications: formulas about a run, evaluated for each row of a scope."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.specification.absence import AbsentError
from symaware_cli.specification.automaton import Automaton, AutomatonMonitor
from symaware_cli.specification.columns import NO_VALUE, Lookup
from symaware_cli.specification.formula import Array
from symaware_cli.specification.formulation import Atom, Formulation
from symaware_cli.specification.monitor import Monitor
from symaware_cli.specification.printing import printed
from symaware_cli.specification.scope import Scope

#: The effect of a violation on the run.
OnViolation = Literal["continue", "end", "event"]


class SpecificationError(Exception):
    """A specification has no value at an instant; the message names the predicate, the agents and the reason."""


@dataclass(frozen=True, slots=True)
class Offer:
    """The terms on which a specification is offered to agents.

    Attributes:
        at: The time of the offer, in nanoseconds; None if an event triggers it.
        open_for: The time for which it can be accepted, in nanoseconds; None for the rest of the run.
        epsilon: The probability with which the agent that accepts it may fail it; None if the scenario has none.
        to: The ids of the agents whose knowledge the run adds it to; others learn of it by messages.
        knowledge: Further knowledge for these agents, as plain values by name.
    """

    at: int | None
    open_for: int | None = None
    epsilon: float | None = None
    to: tuple[str, ...] = ()
    knowledge: Mapping[str, Any] = field(default_factory=dict)


class Instant(dict[str, Any]):
    """The values of names at one instant; each name is looked up at its first use."""

    def __init__(self, getter: Callable[[str], Callable[[], Any]]) -> None:
        """Begin without values; `getter` as for `PredicateSampler`."""
        super().__init__()
        self._getter = getter
        self._getters: dict[str, Callable[[], Any]] = {}

    def __missing__(self, name: str) -> Any:
        getter = self._getters.get(name)
        if getter is None:
            getter = self._getters[name] = self._getter(name)
        value = self[name] = getter()
        return value


@dataclass(frozen=True, slots=True)
class Specification:
    """A formula about a run, evaluated for each row of a scope.

    Attributes:
        name: Its name in the scenario.
        of: Its subject: ``truth`` or ``belief``.
        each: The group whose agents each have a verdict; None for pairs and the world.
        scope: Provides the values of its names.
        formulation: The formula.
        start: The instant that verdicts are about, in nanoseconds.
        end: The last instant that counts, in nanoseconds; None for the end of the run.
        on_violation: The effect of a violation on the run.
        automaton: The automaton of a formula of linear temporal logic; None for signal temporal logic.
        offer: Its offer to agents during the run; None if it is in force by itself.
        explains: Whether the decisions of its monitor name the predicates and instants that determined the verdicts.
        interval: Whether the robust satisfaction interval is computed before the verdict.
    """

    name: str
    of: Literal["truth", "belief", "awareness"]
    each: str | None
    scope: Scope
    formulation: Formulation
    start: int = 0
    end: int | None = None
    on_violation: OnViolation = "event"
    interval: bool = True
    automaton: Automaton | None = None
    explains: bool = True
    offer: Offer | None = None

    def monitor(self, rows: int, arrays: bool = False) -> Monitor | AutomatonMonitor:
        """Create a monitor for some rows, starting now; `arrays` as for `Monitor`."""
        if self.automaton is not None:
            return AutomatonMonitor(self.automaton, rows)
        return Monitor(self.formulation.formula, rows, interval=self.interval, arrays=arrays)

    def values(
        self,
        look_up: Lookup,
        rows: int,
        present: NDArray[np.bool_] | None = None,
        agents: Callable[[int], Sequence[str]] | None = None,
    ) -> list[Array]:
        """Return the robustness of each predicate; each of shape (rows,).

        Args:
            look_up: Returns the values of a name.
            rows: The number of rows.
            present: Which rows must have a value; None for all.
            agents: Returns the ids of the agents that a row is about, for errors; by default those of the scope.

        Raises:
            SpecificationError: A predicate has no value.
        """
        with np.errstate(all="ignore"):
            return PredicateSampler(self, partial(partial, look_up), rows, agents)(present)

    @property
    def text(self) -> str:
        """The text of the formula."""
        return printed(self.formulation.tree)


class PredicateSampler:
    """Samples the predicates of a specification at one instant after another.

    Names are resolved at the first instant. NumPy's warnings are left to the caller; a run ignores them.
    """

    def __init__(
        self,
        specification: Specification,
        getter: Callable[[str], Callable[[], Any]],
        rows: int,
        agents: Callable[[int], Sequence[str]] | None = None,
    ) -> None:
        """Prepare.

        Args:
            specification: The specification.
            getter: Returns a function that returns the present values of a name; called once for each name.
            rows: The number of rows.
            agents: As for `Specification.values`.
        """
        self._specification = specification
        self._atoms = specification.formulation.atoms
        self._agents = agents or specification.scope.agents
        self._shape = (rows,)
        self._values = Instant(getter)
        self._look_up = self._values.__getitem__

    def __call__(self, present: NDArray[np.bool_] | None) -> list[Array]:
        """Return the robustness of each predicate at the present instant, in arrays that are not changed later.

        Args:
            present: Which rows must have a value; None for all.

        Raises:
            SpecificationError: A predicate has no value.
        """
        self._values.clear()
        shape, columns = self._shape, []
        for atom in self._atoms:
            try:
                column = atom.robustness(self._look_up)
                if column.shape != shape:
                    column = np.broadcast_to(column, shape)
            except AbsentError:
                column = np.full(shape, -np.inf)
            except NO_VALUE as error:
                raise SpecificationError(f"`{atom.text}` has no value: {error}") from error
            # NaN counts as the least value. For few rows, this takes half as long as `isnan` of each.
            if column.size and math.isnan(column.item(column.argmin())):
                column = self._without_gaps(atom, column, np.isnan(column), present)
            columns.append(column)
        return columns

    def _without_gaps(
        self, atom: Atom, column: Array, wrong: NDArray[np.bool_], present: NDArray[np.bool_] | None
    ) -> Array:
        """Return the robustness of a predicate that is NaN in some rows, where these need none; see `__call__`."""
        if present is not None:
            wrong &= present
        if wrong.any() and (lacking := self._specification.scope.lacking) is not None:
            column = np.where(wrong & lacking, -np.inf, column)
            wrong &= ~lacking
        if wrong.any():
            who = " and ".join(self._agents(int(wrong.argmax())))
            raise SpecificationError(f"`{atom.text}` has no value" + (f" for {who}" if who else ""))
        return column
