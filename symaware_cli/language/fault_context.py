"""The scenario around a fault, while it is checked: implements the interface of the kinds of faults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NoReturn

from symaware_cli.core import AgentGroup, Environment, GroupComponent
from symaware_cli.core.component import BaseComponent
from symaware_cli.engine import (
    AgentSelection,
    Array,
    ComponentEntry,
    ComponentSelection,
    Fault,
    FaultContext,
)
from symaware_cli.language.diagnosis import Diagnosis, ReportedError
from symaware_cli.language.own_parameters import parameters_of
from symaware_cli.language.plugin_factory import PluginFactory, mapping, words
from symaware_cli.language.problem import nearest, quoted
from symaware_cli.language.sampling import Sampler
from symaware_cli.language.source import Path
from symaware_cli.language.substitute_builder import SubstituteBuilder
from symaware_cli.language.target_finder import TargetFinder
from symaware_cli.world import ProbabilityDistribution, duration_of


class ScenarioContext(FaultContext):
    """The scenario around a fault; see `FaultContext`.

    Attributes:
        added: The component entries to add, each with the one that it follows.
    """

    def __init__(
        self,
        path: Path,
        others: Mapping[str, Fault | None],
        diagnosis: Diagnosis,
        environment: Environment,
        groups: Sequence[AgentGroup],
        targets: TargetFinder,
        factory: PluginFactory,
        substitutes: SubstituteBuilder,
    ) -> None:
        """Prepare.

        Args:
            path: The path of the parameters of the fault, under the key of its kind.
            others: See `FaultContext`.
            diagnosis: Takes the problems.
            environment: See `FaultContext`.
            groups: See `FaultContext`.
            targets: Finds agents and components.
            factory: Creates components with other parameters.
            substitutes: Creates components in place of others.
        """
        self.groups, self.environment, self.others = groups, environment, others
        self.added: list[tuple[ComponentEntry, ComponentEntry]] = []
        self._path = path
        self._diagnosis = diagnosis
        self._data = diagnosis.composition.data
        self._targets = targets
        self._factory = factory
        self._substitutes = substitutes

    def agents(self, pattern: str, *place: str | int) -> list[AgentSelection]:
        """The agents that an id, the name of a group or a pattern matches, at least one."""
        return self._targets.agents(pattern, (*self._path, *place))

    def ids(self, pattern: str, *place: str | int) -> frozenset[str]:
        """The ids of these agents."""
        return frozenset(each.group.ids[row] for each in self.agents(pattern, *place) for row in each.rows)

    def components(self, pattern: str, *place: str | int, substitutes: bool = True) -> list[ComponentSelection]:
        """The components that a pattern matches, at least one; see `FaultContext`."""
        found = self._targets.components(pattern, (*self._path, *place))
        return [each for each in found if substitutes or not each.entry.is_substitute]

    def vector(self, values: Sequence[float], groups: Iterable[AgentGroup], *place: str | int) -> Array:
        """A vector with one number for each element of the state of all groups; shape (nx,)."""
        return self._targets.vector(values, groups, (*self._path, *place))

    def duration(self, latency: Any) -> ProbabilityDistribution:
        """The duration that a `Latency` defines: constant, or drawn for each computation."""
        return duration_of(latency)

    def require_link(self, one: frozenset[str], other: frozenset[str], *place: str | int) -> None:
        """Check that there can be a link between two sets of agents, given by their ids."""
        if len(one | other) < 2:
            (who,) = one
            self.refuse(f"{quoted(who)} has no link with itself", *place)

    def require_pushes(self) -> None:
        """Check that the world supports sudden changes of states."""
        if type(self.environment).push is Environment.push:
            world = quoted(self._data["environment"]["use"])
            self.refuse(f"the world {world} does not support sudden changes of states", code="unsuitable", key=True)

    def knowledge(
        self, agents: AgentSelection, values: Mapping[str, Any], *place: str | int
    ) -> Sequence[Mapping[str, Any]]:
        """The values of knowledge that a mapping, in the form of a group's, defines for each of the agents."""
        group, path = agents.group, (*self._path, *place)
        ids = [group.ids[row] for row in agents.rows]
        sampler = Sampler(self._diagnosis.composition, int(self._data.get("seed", 0)), ids, len(ids) > 1, group.model)
        known = sampler.known(values, path)
        for problem in sampler.problems:
            self._diagnosis.report(problem.code, problem.message, path, expected=problem.expected)
        if sampler.problems:
            raise ReportedError
        return known

    def variants(
        self, components: ComponentSelection, changed: Mapping[str, Any], *place: str | int
    ) -> Sequence[BaseComponent[Any]]:
        """Create a component with some other parameters for each one that is selected, and check that it can work."""
        entry = components.entry
        written = mapping(self._data["agents"][entry.group.name]["components"][entry.name])
        where, shares = (*self._path, *place), isinstance(entry.components[0], GroupComponent)
        made: list[BaseComponent[Any]] = []
        for row in components.rows[:1] if shares else components.rows:
            given = {**parameters_of(written, row), **changed}
            made += self._factory.variants(written, entry.section, given, where, 1)
            if not made:
                raise ReportedError
            if len(made) == 1 or row in entry.own:
                self._check_variant(made[-1], entry, place)
        return made

    def _check_variant(self, component: BaseComponent[Any], entry: ComponentEntry, place: Path) -> None:
        try:
            component.check(entry.group)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self.refuse(f"{quoted(entry.use)} cannot work here: {words(error)}", *place)

    def substitute(
        self, components: ComponentSelection, changed: Mapping[str, Any] | None = None, *place: str | int
    ) -> ComponentEntry:
        """Create a component in place of another one, and add it to the scenario; see `FaultContext`."""
        entry = self._substitutes.build(components, self._path, changed, (*self._path, *place))
        self.added.append((components.entry, entry))
        return entry

    def quoted(self, text: str) -> str:
        """A text of the scenario in backticks, shortened if it is long, for a message."""
        return quoted(text)

    def refuse(
        self,
        message: str,
        *place: str | int,
        code: str = "invalid-value",
        key: bool = False,
        beside: bool = False,
        expected: str | None = None,
        known: Iterable[str] | None = None,
    ) -> NoReturn:
        """Report a problem, and end the checks of this fault; see `FaultContext`."""
        path = (*(self._path[:-1] if beside else self._path), *place)
        suggestion = None if known is None else nearest(str(place[-1]), known)
        self._diagnosis.refuse(code, message, path, key=key, expected=expected, suggestion=suggestion)

    def refuse_unknown(self, noun: str, name: str, known: Iterable[str], *place: str | int) -> NoReturn:
        """Report that nothing has a name, with the names that exist; see `FaultContext`."""
        self._diagnosis.report_unknown(noun, name, (*self._path, *place), known)
        raise ReportedError
