"""From a composed document to a simulation that is ready to run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import yaml

from symaware_cli.core import (
    AgentGroup,
    Component,
    Environment,
    GroupComponent,
    Model,
    Plugin,
    nanoseconds,
)
from symaware_cli.runtime.faults import RunError
from symaware_cli.runtime.simulation import Simulation, Slot
from symaware_cli.scenario.catalogue import Catalogue, PluginError
from symaware_cli.scenario.check import check
from symaware_cli.scenario.compose import Composition, compose
from symaware_cli.scenario.document import Scenario
from symaware_cli.scenario.problem import Problem, ScenarioError, nearest, quoted
from symaware_cli.scenario.sampling import Sampler
from symaware_cli.scenario.source import Path

#: More steps than this are a slip of the pen: at a million steps a second they would take a quarter of an hour.
_MOST_STEPS = 10**9


@dataclass(frozen=True, slots=True)
class Built:
    """A scenario that was found to be sound.

    Attributes:
        document: What the scenario says.
        simulation: What it describes.
        steps: How many steps to make.
        resolved: The one document, as YAML, that the files and overrides amount to; running it repeats the run.
        files: Each file as written, by its path relative to the scenario's folder.
        uses: For each group, the entry-point names of its ``model`` and ``components``.
    """

    document: Scenario
    simulation: Simulation
    steps: int
    resolved: bytes
    files: Mapping[str, bytes]
    uses: Mapping[str, Mapping[str, Any]]


def build(
    path: FilePath,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    catalogue: Catalogue | None = None,
    name: str | None = None,
) -> Built:
    """Read a scenario and make everything it names, without running any of it.

    Args:
        path: The scenario file.
        overrides: What ``--set`` was given, as ``path=value``.
        seed: A seed that wins over the scenario's.
        catalogue: What is installed.
        name: What to call the file in messages; by default its path.

    Raises:
        ScenarioError: With every problem found.
    """
    found: Sequence[Problem] = ()
    try:
        composition = compose(path, overrides, name)
    except ScenarioError as error:
        if error.partial is None:
            raise
        # What is wrong so far lies in single values; the rest can be looked at in the same pass.
        composition, found = error.partial, error.problems
    if seed is not None:
        composition.data["seed"] = seed
    return _Builder(composition, catalogue or Catalogue(), found).build()


class _Builder:
    def __init__(self, composition: Composition, catalogue: Catalogue, found: Sequence[Problem] = ()) -> None:
        self._composition = composition
        self._catalogue = catalogue
        self._found = tuple(found)
        self._problems: list[Problem] = []
        self._uses: dict[str, dict[str, Any]] = {}

    def build(self) -> Built:
        data = self._composition.data
        document = check(Scenario, data, self._composition, ())
        if isinstance(document, list):
            self._problems += document
        seed = document.seed if isinstance(document, Scenario) else 0
        # Plugins are looked at even where the document is broken elsewhere, so that one pass reports everything.
        environment = self._environment(_mapping(data.get("environment")))
        groups, slots = [], []
        for name, entry in _mapping(data.get("agents")).items():
            group, group_slots = self._group(name, _mapping(entry), document, seed)
            if group:
                groups.append(group)
            slots += group_slots
        steps = self._steps(document, environment)
        if self._problems or self._found or isinstance(document, list) or environment is None:
            # A value that was found wrong already is a hole here; what is said of the hole is no news.
            known = {problem.span for problem in self._found}
            raise ScenarioError([*self._found, *(each for each in self._problems if each.span not in known)])
        simulation = self._simulation(document, environment, groups, slots)
        return Built(document, simulation, steps, _resolved(data, document), self._composition.files, self._uses)

    def _report(self, code: str, message: str, path: Path, **hints: Any) -> None:
        self._problems.append(self._composition.problem(code, message, path, **hints))

    def _plugin(self, kind: str, entry: Mapping[str, Any], path: Path) -> Any:
        """Load the plugin of an entry and validate its parameters; None after a problem."""
        use = entry.get("use")
        if not isinstance(use, str):
            return None
        try:
            plugin = self._catalogue.load(kind, use)
        except PluginError as error:
            self._report(error.code, str(error), (*path, "use"), expected=error.expected, suggestion=error.suggestion)
            return None
        given = entry.get("with", {})
        if not isinstance(given, Mapping):
            return None
        where = (*path, "with") if "with" in entry else path
        parameters = check(plugin.Parameters, given, self._composition, where)
        if isinstance(parameters, list):
            self._problems += parameters
            return None
        try:
            # A component author need not know of parameters: without any of its own, a class is called with none.
            return plugin(parameters) if plugin.Parameters is not Plugin.Parameters else plugin()
        except Exception as error:
            self._report("invalid-value", f"{quoted(use)} refuses its parameters: {_words(error)}", where)
            return None

    def _environment(self, entry: Mapping[str, Any]) -> Environment | None:
        environment: Environment | None = self._plugin("environment", entry, ("environment",))
        return environment

    def _group(
        self, name: str, entry: Mapping[str, Any], document: Scenario | list[Problem], seed: int
    ) -> tuple[AgentGroup | None, list[Slot]]:
        path: Path = ("agents", name)
        model: Model | None = self._plugin("model", _mapping(entry.get("model")), (*path, "model"))
        count = entry.get("count")
        sound = isinstance(count, int) and not isinstance(count, bool) and 1 <= count <= 100_000
        indexed = count is not None
        ids = [f"{name}.{row}" for row in range(count or 0)] if sound else [name]
        sampler = Sampler(self._composition, seed, ids, indexed, model)
        states, knowledge = None, []
        if sound or not indexed:
            states = sampler.states(entry.get("state"), (*path, "state"))
            knowledge = self._knowledge(sampler, entry, path, len(ids))
            self._problems += sampler.problems
        self._uses[name] = {"model": _mapping(entry.get("model")).get("use"), "components": {}}
        instances = {
            component: self._instances(_mapping(content), (*path, "components", component), ids)
            for component, content in _mapping(entry.get("components")).items()
        }
        if not isinstance(document, Scenario) or model is None or states is None or sampler.problems:
            return None, []
        group = AgentGroup(name, ids, model, document.agents[name].entity, states, knowledge)
        slots = []
        for component, made in instances.items():
            use = document.agents[name].components[component].use
            self._uses[name]["components"][component] = use
            if made and self._suits(group, made[0], (*path, "components", component), use):
                slots.append(Slot(group, component, use, made))
        return group, slots

    def _knowledge(self, sampler: Sampler, entry: Mapping[str, Any], path: Path, count: int) -> list[dict[str, Any]]:
        knowledge: list[dict[str, Any]] = [{} for _ in range(count)]
        for name, value in _mapping(entry.get("knowledge")).items():
            for own, known in zip(knowledge, sampler.knowledge(value, (*path, "knowledge", name)), strict=False):
                own[name] = known
        return knowledge

    def _instances(self, entry: Mapping[str, Any], path: Path, ids: Sequence[str]) -> list[Any]:
        """Make the component for each agent, or once for a group component; empty after a problem."""
        first = self._plugin("component", entry, path)
        if first is None:
            return []
        if isinstance(first, GroupComponent):
            return [first]
        kind = type(first)
        others = len(ids) - 1
        if kind.Parameters is Plugin.Parameters:
            return [first, *(kind() for _ in range(others))]
        # Parameters are frozen or each agent's own: none may reach another agent through a shared mutable value.
        return [first, *(kind(first.parameters.model_copy(deep=True)) for _ in range(others))]

    def _suits(self, group: AgentGroup, component: Component | GroupComponent, path: Path, use: str) -> bool:
        """Whether a component can do its work for a group, as far as that can be told before the run."""
        known = set(group.knowledge[0])
        for name, meaning in component.knowledge.items():
            if name not in known:
                self._report(
                    "missing-knowledge",
                    f"{quoted(use)} needs the knowledge {quoted(name)}",
                    path,
                    expected=f"`knowledge: {{{name}: ...}}` in `agents.{group.name}`: {meaning}",
                    suggestion=nearest(name, known),
                )
        if not known.issuperset(component.knowledge):
            return False
        try:
            component.check(group)
        except Exception as error:
            self._report("unsuitable", f"{quoted(use)} cannot work here: {_words(error)}", path)
            return False
        return True

    def _steps(self, document: Scenario | list[Problem], environment: Environment | None) -> int:
        if not isinstance(document, Scenario) or environment is None:
            return 0
        duration = nanoseconds(document.run.duration)
        steps = math.ceil(duration / environment.time_step)
        if steps > _MOST_STEPS:
            self._report(
                "too-long",
                f"the run would take {steps:,} steps",
                ("run", "duration"),
                expected=f"at most {_MOST_STEPS:,} steps of {environment.time_step / 1e9:g} s",
            )
        return max(steps, 1)

    def _simulation(
        self, document: Scenario, environment: Environment, groups: list[AgentGroup], slots: list[Slot]
    ) -> Simulation:
        try:
            return Simulation(
                name=document.name,
                seed=document.seed,
                environment=environment,
                environment_use=document.environment.use,
                groups=groups,
                slots=slots,
                obstacles=document.environment.entities,
            )
        except RunError as error:
            self._report(
                "unsuitable", f"{quoted(error.plugin)} cannot set up the world: {error.problem}", ("environment",)
            )
            raise ScenarioError(self._problems) from error


def _resolved(data: Mapping[str, Any], document: Scenario) -> bytes:
    """Write the resolved document, in the order of the file, with the seed in force."""
    first = {"symaware": document.symaware, "name": document.name, "seed": document.seed}
    content = {**first, **{key: value for key, value in data.items() if key not in first}}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=100).encode()


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _words(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError | NotImplementedError) and text else f"{type(error).__name__}: {text}"
