"""The task of learning agents in a scenario: checked with the scenario, and bound to a simulation of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import AgentGroup, Environment, Plugin, ScenarioView
from symaware_cli.geometry import Region
from symaware_cli.learning.given_inputs import GivenInputs
from symaware_cli.learning.learning_content import ActionBounds, LearningUse, NearestOthers, RewardTerm, SignalValues
from symaware_cli.learning.reward import Reward, reward_of
from symaware_cli.learning.team import LearningError, Team

Array = NDArray[np.float64]


class LearningTask(Plugin):
    """The section `learning` of a scenario.

    Attributes:
        content: The content of the section.
        inputs: The actions of an episode that is repeated; None in a scenario to learn in.
        specifications: The names of the specifications of the scenario.
    """

    uncaptured = ("*",)

    def __init__(self, content: LearningUse, inputs: GivenInputs | None, specifications: Iterable[str] = ()) -> None:
        super().__init__()
        self.content = content
        self.inputs = inputs
        self.specifications = tuple(specifications)

    def check_scenario(self, view: ScenarioView) -> None:
        """Check the agents, and that every expression, signal and bound fits them."""
        if self.inputs is not None:
            problem = self.inputs.problem(view.groups)
            if problem is not None:
                view.report(problem, "inputs", key=False)
                return
        members = self.members(view.groups)
        for place, name, rows in members:
            if not rows:
                view.report_unknown("agent or group", name, *place, known=_names(view.groups))
        if all(rows for _, _, rows in members):
            for team in self.teams(view.groups, view.environment, view.document.regions, view.specifications):
                self._check(team, view)

    def _check(self, team: Team, view: ScenarioView) -> None:
        """Report entries that do not fit the agents of a team."""
        content = self.content
        for number, entry in enumerate(content.observation):
            self._tried(partial(self._observed, team, entry), view, "observation", number)
        written = content.reward
        for number, term in enumerate(content.terms):
            place: tuple[str | int, ...] = ("reward", number) if isinstance(written, list) else ("reward",)
            inner = () if isinstance(written[number] if isinstance(written, list) else written, str) else ("value",)
            if term.specification is not None:
                self._check_specification(term, view, team, *place, "specification")
            else:
                self._tried(partial(_one, team, term), view, *place, *inner)
        if content.terminate is not None:
            text = content.terminate
            self._tried(partial(team.condition, "truth", text), view, "terminate")
        try:
            bounds_of(team.of, content.action)
        except LearningError as error:
            view.report(str(error), "action", key=True)

    @staticmethod
    def _tried(make: Callable[[], Callable[[], Any]], view: ScenarioView, *place: str | int) -> None:
        """Compile an entry, and compute it once if there is a world."""
        try:
            compute = make()
            if view.is_initialised and hasattr(view.groups[0], "surroundings"):
                with np.errstate(all="ignore"):
                    compute()
        except LearningError as error:
            view.report(str(error), *place, key=False, code="bad-expression")

    @staticmethod
    def _check_specification(term: RewardTerm, view: ScenarioView, team: Team, *place: str | int) -> None:
        name = term.specification or ""
        specification = view.specifications.get(name)
        if specification is None:
            view.report_unknown("specification", name, *place, known=view.specifications)
            return
        use = view.document.specifications[name]
        if specification.offer is not None:
            view.report(f"`{name}` is offered, and not that of an agent from the beginning", *place, key=False)
        elif specification.automaton is not None:
            view.report(f"`{name}` is an automaton, which has no robustness", *place, key=False)
        elif use.each not in (None, team.group):
            view.report(f"`{name}` is about `{use.each}`, not about `{team.group}`", *place, key=False)

    @staticmethod
    def _observed(team: Team, entry: str | NearestOthers | SignalValues) -> Callable[[], Array]:
        """Return the function that computes an entry of the observation."""
        if isinstance(entry, str):
            return team.columns("belief", entry)
        if isinstance(entry, SignalValues):
            return partial(team.signal, entry.signal)
        return partial(team.nearest, entry.nearest, entry.of)

    def members(self, groups: Sequence[AgentGroup]) -> list[tuple[tuple[str | int, ...], str, dict[str, list[int]]]]:
        """Return the place and the name of each entry of `agents`, and the rows of a run that it denotes, by group."""
        written = self.content.agents
        names = [written] if isinstance(written, str) else written
        found: list[tuple[tuple[str | int, ...], str, dict[str, list[int]]]] = []
        for number, name in enumerate(names):
            place: tuple[str | int, ...] = ("agents",) if isinstance(written, str) else ("agents", number)
            rows = {}
            for group in groups:
                ids = [id.partition(":")[2] for id in _of_one_run(group)] if group.seeds else list(group.ids)
                if group.name == name:
                    rows[group.name] = list(range(len(ids)))
                elif name in ids:
                    rows[group.name] = [ids.index(name)]
            found.append((place, name, rows))
        return found

    def teams(
        self,
        groups: Sequence[AgentGroup],
        environment: Environment,
        regions: Mapping[str, Region],
        specifications: Mapping[str, Any],
    ) -> list[Team]:
        """Return the learning agents of each group; for a group of a batch, those of all runs."""
        rows: dict[str, set[int]] = {}
        for _, _, found in self.members(groups):
            for name, own in found.items():
                rows.setdefault(name, set()).update(own)
        return [
            Team(group, _of_all_runs(group, rows[group.name]), environment, groups, regions, tuple(specifications))
            for group in groups
            if group.name in rows
        ]

    def observation(self, team: Team) -> Callable[[], Array]:
        """Return the function that computes the observations of a team as a new array, shape (n, k).

        Like all functions of a task it is to be called with NumPy's warnings off.
        """
        parts = [self._observed(team, each) for each in self.content.observation]
        return lambda: np.concatenate([each() for each in parts], axis=1)

    def reward(self, team: Team) -> Reward:
        """Return the reward of a team."""
        return reward_of(team, self.content.terms)

    def termination(self, team: Team) -> Callable[[], NDArray[np.bool_]] | None:
        """Return the condition that ends the episode of an agent; None without one."""
        text = self.content.terminate
        return None if text is None else team.condition("truth", text)


def _one(team: Team, term: RewardTerm) -> Callable[[], Array]:
    """Return the function of a term, with one value for each agent."""
    text = term.value or ""
    compute = team.columns(term.of, text)

    def checked() -> Array:
        found = compute()
        if found.shape[1] != 1:
            raise LearningError(f"`{text}` has {found.shape[1]} values for each agent, and a reward is one number")
        return found

    return checked


def bounds_of(group: AgentGroup, written: ActionBounds) -> tuple[Array, Array]:
    """Return the bounds of the actions of a group's agents, each of shape (nu,).

    Raises:
        LearningError: The bounds do not fit the model.
    """
    model = group.model
    names = [quantity.name for quantity in model.control_input]
    limits = [np.array(each, float) for each in model.input_bounds()]
    found = []
    for key, given, limit in zip(("low", "high"), (written.low, written.high), limits, strict=True):
        bound = limit
        if given is not None:
            bound = np.array(given, float)
            if bound.ndim and len(bound) != len(names):
                raise LearningError(f"`{key}` has {len(bound)} numbers for {', '.join(names)} of `{group.name}`")
            bound = np.broadcast_to(bound, limit.shape).copy()
        found.append(bound)
    low, high = found
    for column, name in enumerate(names):
        if low[column] < limits[0][column] or high[column] > limits[1][column]:
            known = f"{limits[0][column]:g} to {limits[1][column]:g}"
            said = f"{low[column]:g} to {high[column]:g}"
            raise LearningError(f"{name} of `{group.name}` is limited to {known}, so actions cannot be from {said}")
        if not low[column] < high[column]:
            raise LearningError(f"{name} of `{group.name}` has no room between {low[column]:g} and {high[column]:g}")
    return low, high


def _names(groups: Sequence[AgentGroup]) -> Iterator[str]:
    for group in groups:
        yield group.name
        yield from group.ids


def _of_one_run(group: AgentGroup) -> Sequence[str]:
    return group.ids[: len(group) // group.runs]


def _of_all_runs(group: AgentGroup, rows: Collection[int]) -> list[int]:
    share = len(group) // group.runs
    return [run * share + row for run in range(group.runs) for row in sorted(rows)]
