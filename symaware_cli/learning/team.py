"""Teams: the learning agents of one group, with expressions that are evaluated for all of them at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment
from symaware_cli.engine import STATUS_NAMES
from symaware_cli.geometry import Region, lengths
from symaware_cli.specification import AgentScope, BeliefScope, ExpressionError, Keys, MonitorStatuses, parse
from symaware_cli.specification.columns import ARGUMENTS, NO_VALUE, check_momentary, truth, values

Array = NDArray[np.float64]

#: The states that expressions refer to.
About = Literal["truth", "belief"]

#: Computes numbers for each agent of a team; shape (n, k).
Columns = Callable[[], Array]

#: Maximum length of an expression, in characters.
_LONGEST = 500


class LearningError(ValueError):
    """An expression, a signal or a function cannot serve as an observation, a reward or a condition."""


class Team:
    """The learning agents of one group, as functions of observations, rewards and terminations see them.

    Attributes:
        group: The name of the group.
        agents: The ids of the agents, in the order of rows.
        everybody: Truths, read-only; shape (n,).
    """

    def __init__(
        self,
        group: AgentGroup,
        rows: Sequence[int],
        environment: Environment,
        groups: Sequence[AgentGroup],
        regions: Mapping[str, Region],
        specifications: Collection[str],
    ) -> None:
        """Prepare.

        Args:
            group: The group.
            rows: The rows of the agents, ascending.
            environment: The world.
            groups: All groups.
            regions: The regions of the scenario, by name.
            specifications: The names of the specifications.
        """
        self.group = group.name
        self.agents = tuple(group.ids[row] for row in rows)
        self.of = group
        self.rows = np.array(rows, np.intp)
        self.everybody = np.ones(len(rows), bool)
        self.everybody.flags.writeable = False
        self._all = len(rows) == len(group)
        self._specifications = tuple(specifications)
        beliefs = {name: each for name, each in regions.items() if each.around is None}
        self._scopes: Mapping[About, AgentScope] = {
            "truth": AgentScope(group, environment, groups, regions),
            "belief": BeliefScope(group, environment, groups, beliefs),
        }
        self._environment = environment
        self._compiled: dict[tuple[About, str], Columns] = {}

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.of.surroundings.clock.now / 1e9

    @property
    def environments(self) -> int:
        """The number of environments that the agents are from; agents are in the order of environments."""
        return self.of.runs

    @property
    def present(self) -> NDArray[np.bool_]:
        """Whether each agent is in the world; shape (n,)."""
        here = self.of.present
        return self.everybody if here is None else here[self.rows]

    def true(self, expression: str) -> Array:
        """Evaluate an expression about the true states; shape (n, k)."""
        return self._evaluated("truth", expression)

    def believed(self, expression: str) -> Array:
        """Evaluate an expression about the beliefs of the agents; shape (n, k)."""
        return self._evaluated("belief", expression)

    def _evaluated(self, about: About, text: str) -> Array:
        compute = self._compiled.get((about, text))
        if compute is None:
            compute = self._compiled[about, text] = self.columns(about, text)
        with np.errstate(all="ignore"):
            return np.array(compute())

    def columns(self, about: About, text: str) -> Columns:
        """Compile an expression into a function that evaluates it; to be called with NumPy's warnings off.

        The array may be one that others hold, and is not to be changed.

        Raises:
            LearningError: It is invalid.
        """
        tree, lookup = self._parsed(about, text)
        evaluate = values(tree)

        def compute() -> Array:
            try:
                return self._shaped(evaluate(lookup))
            except NO_VALUE as error:
                raise LearningError(f"`{text}` has no value: {_said(error)}") from error

        return compute

    def condition(self, about: About, text: str) -> Callable[[], NDArray[np.bool_]]:
        """Compile a condition, shape (n,), into a function that evaluates it; see `columns`.

        Raises:
            LearningError: It is invalid.
        """
        tree, lookup = self._parsed(about, text)
        evaluate = truth(tree)

        def compute() -> NDArray[np.bool_]:
            try:
                found = np.broadcast_to(evaluate(lookup), (len(self.of),))
            except NO_VALUE as error:
                raise LearningError(f"`{text}` has no value: {_said(error)}") from error
            return np.asarray(found[self.rows], bool)

        return compute

    def _parsed(self, about: About, text: str) -> tuple[Any, Callable[[str], Any]]:
        scope = self._scopes[about]
        names = {**scope.names, **dict.fromkeys(STATUS_NAMES, Keys("specification", self._specifications))}
        try:
            tree = parse(text, names, ARGUMENTS, longest=_LONGEST)
            check_momentary(tree, "a specification, whose robustness may be a reward")
        except ExpressionError as error:
            raise LearningError(f"`{text}`: {error}") from error
        getters: dict[str, Callable[[], Any]] = {}

        def look_up(name: str) -> Any:
            get = getters.get(name)
            if get is None:
                statuses = partial(_Statuses, self.of, name)
                get = getters[name] = statuses if name in STATUS_NAMES else scope.getter(name)
            return get()

        return tree, look_up

    def _shaped(self, value: Any) -> Array:
        """Return the values of the team's agents, shape (n, k), from those of all rows of the group."""
        found = np.asarray(value)
        if found.dtype.kind not in "fbiu":
            raise TypeError("it is not a number")
        count = len(self.of)
        if found.ndim == 2 and len(found) == count:
            pass
        elif found.ndim == 1 and len(found) == count:
            found = found[:, None]
        elif found.ndim < 2:
            found = np.broadcast_to(found, (count,))[:, None]
        else:
            found = np.broadcast_to(found, (count, *found.shape[1:])).reshape(count, -1)
        return np.asarray(found if self._all else found[self.rows], float)

    def signal(self, name: str) -> Array:
        """Return a signal of a component, or a part of awareness; of a series, the first point; shape (n, k).

        Raises:
            LearningError: There is no such signal.
        """
        awareness = self.of.awareness
        declared = {**awareness.parts, **awareness.signals}.get(name)
        column = awareness.columns.get(name)
        if declared is None or column is None or declared.kind == "table":
            known = ", ".join(sorted(awareness.columns))
            raise LearningError(f"the agents of `{self.group}` have no signal `{name}`; there are: {known}")
        found = [np.ravel(column.present(row)) for row in self.rows.tolist()]
        width = max(map(len, found))
        if any(len(each) != width for each in found):
            raise LearningError(f"`{name}` has other numbers of values for some agents of `{self.group}`")
        return np.array(found, float)

    def nearest(self, count: int, of: Sequence[str] = ("position", "velocity")) -> Array:
        """Return the motion of the nearest others that each agent is aware of, nearest first; zeros if there are fewer.

        Args:
            count: The number of others.
            of: The quantities of each: ``position`` relative to the agent's [m], ``velocity`` [m/s], ``distance`` [m],
                or ``present``, which is 1.

        Returns:
            Shape (n, count * width).
        """
        group = self.of
        tracks = group.others(np.inf)
        own = group.model.positions(group.awareness.state)
        dimensions = tracks.positions.shape[1]
        observers = tracks.observers
        apart = np.array(tracks.positions)
        apart[:, : own.shape[1]] -= own[observers]
        distances = lengths(apart)
        order = np.lexsort((tracks.others, distances, observers))
        places = np.arange(len(order)) - tracks.pointers[observers]  # `observers` ascend before and after sorting
        order, rows, places = (each[places < count] for each in (order, observers, places))
        widths = {"position": dimensions, "velocity": dimensions, "distance": 1, "present": 1}
        found = np.zeros((len(group), count, sum(widths[each] for each in of)))
        start = 0
        for each in of:
            match each:
                case "position":
                    part = apart[order]
                case "velocity":
                    part = tracks.velocities[order]
                case "distance":
                    part = distances[order, None]
                case _:
                    part = np.ones((len(order), 1))
            found[rows, places, start : start + widths[each]] = part
            start += widths[each]
        flat = found.reshape(len(group), -1)
        return flat if self._all else flat[self.rows]

    def robustness(self, name: str) -> Array:
        """Return the robustness of a specification on the samples up to the present one; shape (n,).

        NaN for agents that the specification does not concern.
        """
        statuses = self.of.specifications[name]
        assert isinstance(statuses, MonitorStatuses)
        return np.array([np.nan if statuses.of(id) is None else statuses.measured(id) for id in self.agents])

    def decided(self, name: str) -> NDArray[np.bool_]:
        """Return whether a specification is decided, satisfied or violated, for each agent; shape (n,).

        The monitor evaluates an instant after its control inputs were given, so the verdict is known one step later.
        """
        statuses = self.of.specifications[name]
        found = [statuses.of(id) for id in self.agents]
        return np.array([each is not None and each.verdict is not None for each in found])


class _Statuses:
    """A figure of the status of specifications, for each agent of a group."""

    def __init__(self, group: AgentGroup, figure: str) -> None:
        self._group, self._figure = group, figure

    def __getitem__(self, name: str) -> Array | NDArray[np.bool_]:
        if name not in self._group.specifications:  # before the run
            return (
                np.full(len(self._group), np.nan) if self._figure == "robustness" else np.zeros(len(self._group), bool)
            )
        statuses = [self._group.specifications[name].of(id) for id in self._group.ids]
        if self._figure == "robustness":
            return np.array([np.nan if each is None else each.robustness for each in statuses])
        satisfied = self._figure == "satisfied"
        return np.array([each is not None and each.verdict is satisfied for each in statuses])


def _said(error: BaseException) -> str:
    return " ".join(str(error).split()).strip("\"'") or type(error).__name__
