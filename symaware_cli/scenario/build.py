"""Builds a simulation from a composed document: validates it, loads plugins, creates groups and components."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symaware_cli.core import (
    AgentGroup,
    Component,
    Entity,
    Environment,
    GroupComponent,
    Model,
    Quantity,
    WorldError,
    nanoseconds,
)
from symaware_cli.distributed.transport import Transport
from symaware_cli.models.conformity import faults_of
from symaware_cli.network.topology.topology import Topology
from symaware_cli.runtime.failure import RunError
from symaware_cli.runtime.faults import Fault
from symaware_cli.runtime.options import RunOptions
from symaware_cli.runtime.presence import PresenceInterval
from symaware_cli.runtime.scope import further_parts
from symaware_cli.runtime.simulation import ComponentEntry, Simulation
from symaware_cli.runtime.timing import Trigger
from symaware_cli.scenario.assets import assets, check_assets
from symaware_cli.scenario.catalogue import Catalogue
from symaware_cli.scenario.compose import Composition, CompositionError, compose
from symaware_cli.scenario.consensus_check import check_consensus, check_metropolis
from symaware_cli.scenario.document import ScenarioDocument
from symaware_cli.scenario.fault_builder import FaultBuilder
from symaware_cli.scenario.network_builder import NetworkBuilder
from symaware_cli.scenario.overrides import Override
from symaware_cli.scenario.parts import check_omitted, declared_parts, declared_signals, name_columns
from symaware_cli.scenario.plugin_factory import PluginFactory, mapping, topologies, words
from symaware_cli.scenario.presence_builder import PresenceBuilder
from symaware_cli.scenario.problem import Problem, ScenarioError, dotted, nearest, quoted
from symaware_cli.scenario.requirement import check_requirements
from symaware_cli.scenario.resolved import resolved
from symaware_cli.scenario.sampling import Sampler
from symaware_cli.scenario.source import Path
from symaware_cli.scenario.specifications import SpecificationBuilder, check_values
from symaware_cli.scenario.timing_check import TimingCheck
from symaware_cli.scenario.validation import validate
from symaware_cli.specification.specification import Specification

Array = NDArray[np.float64]

#: The greatest number of steps; more are taken for a mistake: at a million steps per second they take 17 minutes.
_MOST_STEPS = 10**9

#: Sections in which an entry can be checked where another one is wrong.
_INDEPENDENT = ("faults", "specifications")

_REFERENCES = {"bad-reference", "cyclic-parameter", "undefined-parameter"}


@dataclass(frozen=True, slots=True)
class Built:
    """A valid scenario, built and ready to run.

    Attributes:
        document: The validated document.
        simulation: The simulation.
        steps: The number of steps to make.
        options: The options of the run.
        data: The resolved document as plain data.
        files: Each file as written, including assets such as meshes, by its path relative to the scenario's folder.
        uses: For each group, the entry-point names of its ``model`` and ``components``.
        transport: The transport of a run in several processes; None if the scenario names none.
    """

    document: ScenarioDocument
    simulation: Simulation
    steps: int
    options: RunOptions
    data: Mapping[str, Any]
    files: Mapping[str, bytes]
    uses: Mapping[str, Mapping[str, Any]]
    transport: Transport | None = None

    @property
    def resolved(self) -> bytes:
        """The resolved document as YAML, written at each access; running it repeats the run."""
        return resolved(self.data, self.document)

    @property
    def digest(self) -> bytes:
        """The SHA-256 of the resolved document, which identifies the scenario."""
        return hashlib.sha256(self.resolved).digest()


def build(
    path: FilePath,
    overrides: Sequence[str | Override] = (),
    seed: int | None = None,
    catalogue: Catalogue | None = None,
    name: str | None = None,
    world: Callable[[Environment], Environment] | None = None,
    statements: FilePath | None = None,
) -> Built:
    """Read a scenario and create all its objects, without running it.

    Args:
        path: The scenario file.
        overrides: The arguments of ``--set``, as ``path=value`` or parsed.
        seed: A seed in place of the scenario's.
        catalogue: The installed plugins.
        name: The name of the file in messages; by default its path.
        world: Returns an environment to use in place of the scenario's; None to use that one.
        statements: A file of specifications to use in place of the scenario's.

    Raises:
        ScenarioError: Contains every problem found.
    """
    found: Sequence[Problem] = ()
    try:
        composition = compose(path, overrides, name, statements)
    except CompositionError as error:
        # The problems so far concern single values; the rest can be checked in the same pass.
        composition, found = error.partial, error.problems
    return build_composition(composition, path.parent, seed, catalogue, found, world)


@np.errstate(all="ignore")  # as while it runs
def build_composition(
    composition: Composition,
    folder: FilePath,
    seed: int | None = None,
    catalogue: Catalogue | None = None,
    found: Sequence[Problem] = (),
    world: Callable[[Environment], Environment] | None = None,
) -> Built:
    """Create all objects of a composed document; see `build`.

    Args:
        composition: The document; it can be built once, so copy it before to build it again.
        folder: The folder of its file.
        seed: A seed in place of the scenario's.
        catalogue: The installed plugins.
        found: Problems with single values that are already known.
        world: See `build`.

    Raises:
        ScenarioError: Contains every problem found.
    """
    if seed is not None:
        composition.data["seed"] = seed
    return _SimulationBuilder(composition, catalogue or Catalogue(), found, folder, world).build()


class _SimulationBuilder:
    def __init__(
        self,
        composition: Composition,
        catalogue: Catalogue,
        found: Sequence[Problem],
        folder: FilePath,
        world: Callable[[Environment], Environment] | None,
    ) -> None:
        self._composition = composition
        self._folder = folder
        self._world = world
        self._found = tuple(found)
        self._problems: list[Problem] = []
        self._uses: dict[str, dict[str, Any]] = {}
        #: The names of the parts of awareness that components declare.
        self._declared: set[str] = set()
        self._factory = PluginFactory(composition, catalogue, self._report, self._problems.extend)

    def build(self) -> Built:
        data = self._composition.data
        self._factory.load(data)
        document = validate(ScenarioDocument, data, self._composition, (), self._factory.parameters)
        if isinstance(document, list):
            if any(problem.code == "wrong-version" for problem in document):
                # Other problems are meaningless in another version of the format.
                raise ScenarioError([problem for problem in document if problem.code == "wrong-version"])
            self._problems += document
            document = self._sound_part(data, document)
        # Objects are created even if the document has problems elsewhere, so that one pass reports everything.
        seed = document.seed if isinstance(document, ScenarioDocument) else 0
        environment = self._environment(mapping(data.get("environment")))
        groups, component_entries = [], []
        for name, entry in mapping(data.get("agents")).items():
            group, group_slots = self._group(name, mapping(entry), document, seed)
            if group:
                groups.append(group)
            component_entries += group_slots
        steps = self._steps(mapping(data.get("run")).get("duration"), environment)
        networks = self._topologies(data.get("topology"))
        transport = next(iter(self._factory.make(mapping(data.get("transport")), ("transport",))), None)
        check_omitted(mapping(data.get("recording")).get("omit"), self._declared, self._report)
        options, network = RunOptions(), None
        if isinstance(document, ScenarioDocument) and environment is not None:
            options = self._options(document, environment, groups, component_entries)
            check_requirements(document, environment, groups, component_entries, self._report)
            check_assets(document, environment, self._folder, self._report)
            check_consensus(document, environment.time_step, component_entries, self._report)
            if document.topology is not None and len(groups) == len(document.agents):
                builder = NetworkBuilder(self._report, environment, groups, seed)
                narrowed = any(each.degrade and each.degrade.bandwidth for each in document.faults.values())
                network = builder.build(document.topology, networks, narrowed=narrowed)
                if network is not None:
                    check_metropolis(document.topology, network, builder.links, component_entries, self._report)
        if self._problems or self._found or isinstance(document, list) or environment is None:
            raise ScenarioError([*self._found, *filter(self._is_independent, self._problems)])
        simulation = self._simulation(document, environment, groups, component_entries)
        check_values(options.specifications, self._report)
        if self._problems:
            raise ScenarioError(self._problems)
        if network is not None:
            simulation.connect(network)
        files = {**self._composition.files, **assets(document, self._folder)}
        return Built(document, simulation, steps, options, data, files, self._uses, transport)

    def _sound_part(self, data: Mapping[str, Any], problems: list[Problem]) -> ScenarioDocument | list[Problem]:
        """The document without its wrong entries, if these are in sections whose entries do not need each other."""
        wrong = {tuple(problem.path.split(".")[:2]) for problem in problems}
        if not all(len(each) == 2 and each[0] in _INDEPENDENT for each in wrong):
            return problems
        rest = {**data}
        for section, name in wrong:
            rest[section] = {key: entry for key, entry in rest[section].items() if key != name}
        return validate(ScenarioDocument, rest, self._composition, (), self._factory.parameters)

    def _options(
        self,
        document: ScenarioDocument,
        environment: Environment,
        groups: Sequence[AgentGroup],
        component_entries: Sequence[ComponentEntry],
    ) -> RunOptions:
        """Build the options of the run, and set the timing of the components."""
        check = TimingCheck(
            self._composition,
            environment,
            self._problems.append,
            document.regions,
            mapping(self._composition.data.get("specifications")),
        )
        for component_entry in component_entries:
            use = document.agents[component_entry.group.name].components[component_entry.name]
            path: Path = ("agents", component_entry.group.name, "components", component_entry.name)
            component_entry.timing = check.timing(use, component_entry.group, type(component_entry.components[0]), path)
        check.triggers(component_entries)
        run, until = document.run, check.until(document.run, groups)
        faults: Sequence[Fault | None] = ()
        presence: Mapping[str, Sequence[PresenceInterval]] = {}
        specifications: Sequence[Specification] = ()
        instances: Mapping[str, Trigger] = {}
        if len(groups) == len(document.agents):
            builder = FaultBuilder(
                self._composition, self._report, check, environment, groups, component_entries, document.faults
            )
            faults = [builder.build(name, use) for name, use in document.faults.items()]
            members = PresenceBuilder(self._report, check, environment, document.environment.use, component_entries)
            presence = members.build(groups, document.agents)
            statements = SpecificationBuilder(
                self._report,
                check,
                environment,
                environment.time_step,
                groups,
                component_entries,
                further_parts(groups),
            )
            specifications = statements.build(document)
            instances = statements.triggers
        return RunOptions(
            mode=run.mode,
            until=until,
            pace=run.pace,
            turn_limit=run.turn_limit,
            workers=run.workers,
            faults=tuple(fault for fault in faults if fault is not None),
            presence=presence,
            specifications=specifications,
            instances=instances,
        )

    def _is_independent(self, problem: Problem) -> bool:
        """Whether a problem is more than a consequence of a value that is invalid, which is already reported."""
        if any(problem.span == known.span for known in self._found):
            return False
        return not any(f"{problem.path}.".startswith(f"{path}.") for path in self._invalid_paths)

    @cached_property
    def _invalid_paths(self) -> set[str]:
        """The paths of invalid values, and of texts with references that could not be resolved."""
        paths = {known.path for known in self._found}
        if any(known.code in _REFERENCES for known in self._found):
            paths |= {dotted(path) for path in _unresolved(self._composition.data, ())}
        return paths

    def _report(self, code: str, message: str, path: Path, **hints: Any) -> None:
        self._problems.append(self._composition.problem(code, message, path, **hints))

    def _environment(self, entry: Mapping[str, Any]) -> Environment | None:
        made = self._factory.make(entry, ("environment",))
        if not made:
            return None
        environment: Environment = made[0]
        step = getattr(environment, "time_step", None)
        if not isinstance(step, int) or step < 1:
            self._report("broken-plugin", f"{quoted(entry['use'])} has no time step", ("environment", "use"))
            return None
        environment.folder = self._folder
        return environment if self._world is None else self._world(environment)

    def _topologies(self, entry: Any) -> dict[Path, Topology]:
        """Create every topology of the section, by its path."""
        made = {path: self._factory.make(each, path) for path, each in topologies(entry)}
        return {path: instances[0] for path, instances in made.items() if instances}

    def _model(self, entry: Mapping[str, Any], path: Path) -> Model | None:
        made = self._factory.make(entry, path)
        if not made:
            return None
        model: Model = made[0]
        fault = _fault_of(model)
        if fault:
            self._report("broken-plugin", f"the model {quoted(entry['use'])} {fault}", (*path, "use"))
            return None
        return model

    def _conforms(self, model: Model, use: str, state: Array, path: Path) -> bool:
        """Check that a model returns arrays of the declared shapes; done once, as checks in a run would cost time."""
        faults = list(faults_of(model, state))
        for fault in faults:
            self._report("broken-plugin", f"the model {quoted(use)} {fault}", path)
        return not faults

    def _group(
        self, name: str, entry: Mapping[str, Any], document: ScenarioDocument | list[Problem], seed: int
    ) -> tuple[AgentGroup | None, list[ComponentEntry]]:
        path: Path = ("agents", name)
        model = self._model(mapping(entry.get("model")), (*path, "model"))
        count = entry.get("count")
        sound = isinstance(count, int) and not isinstance(count, bool) and 1 <= count <= 100_000
        indexed = count is not None
        ids = [f"{name}.{row}" for row in range(count)] if sound and count else [name]
        # Even if the model's parameters are invalid, its class declares the columns of the state.
        kind = self._factory.plugins.get((*path, "model"))
        described = model or (kind if kind is not None and _fault_of(kind) is None else None)
        sampler = Sampler(self._composition, seed, ids, indexed, described)
        states, knowledge = None, []
        if sound or not indexed:
            states = sampler.states(entry.get("state"), (*path, "state"))
            knowledge = self._knowledge(sampler, entry, path, len(ids))
            self._problems += sampler.problems
        components = mapping(entry.get("components"))
        uses = {component: str(mapping(content).get("use")) for component, content in components.items()}
        uses_model = mapping(entry.get("model")).get("use")
        self._uses[name] = {"model": uses_model, "components": uses}
        instances = {
            component: self._factory.make(mapping(content), (*path, "components", component), len(ids))
            for component, content in components.items()
        }
        capable = [
            component
            for component, made in instances.items()
            if made and self._has_knowledge(made[0], entry, (*path, "components", component), uses[component])
        ]
        declaring = [(instances[each][0], uses[each], (*path, "components", each)) for each in capable]
        parts, signals = declared_parts(declaring, self._report), declared_signals(declaring, self._report)
        self._declared.update(each.name for each in (*parts, *signals.values()))
        if model is None or states is None or sampler.problems or self._found:
            return None, []
        body = document.agents[name].entity if isinstance(document, ScenarioDocument) else Entity()
        if not self._conforms(model, str(uses_model), states[0], (*path, "model", "use")):
            return None, []
        group = AgentGroup(name, ids, model, body, states, knowledge, parts, signals)
        group.regions = document.regions if isinstance(document, ScenarioDocument) else {}
        component_entries = [
            ComponentEntry(group, component, uses[component], instances[component])
            for component in capable
            if self._can_work(group, instances[component][0], (*path, "components", component), uses[component])
        ]
        return group, component_entries

    def _knowledge(self, sampler: Sampler, entry: Mapping[str, Any], path: Path, count: int) -> list[dict[str, Any]]:
        knowledge: list[dict[str, Any]] = [{} for _ in range(count)]
        for name, value in mapping(entry.get("knowledge")).items():
            for own, known in zip(knowledge, sampler.knowledge(value, (*path, "knowledge", name)), strict=False):
                own[name] = known
        return knowledge

    def _has_knowledge(
        self, component: Component | GroupComponent, entry: Mapping[str, Any], path: Path, use: str
    ) -> bool:
        """Check that the agents have all the knowledge that a component needs."""
        known = entry.get("knowledge", {})
        if not isinstance(known, Mapping):
            return False
        for name, meaning in component.knowledge.items():
            if name in known:
                continue
            meant = nearest(name, known)
            where = (*path[:2], "knowledge", meant) if meant else path
            self._report(
                "missing-knowledge",
                f"{quoted(use)} needs the knowledge {quoted(name)}" + (f", not {quoted(meant)}" if meant else ""),
                where,
                key=True,
                expected=f"{quoted(name)} under {quoted(dotted((*path[:2], 'knowledge')))}: {meaning}",
            )
        return set(component.knowledge) <= set(known)

    def _can_work(self, group: AgentGroup, component: Component | GroupComponent, path: Path, use: str) -> bool:
        """Check that a component can work for a group, as far as that is known before the run."""
        try:
            component.check(group)
            # If several components set a series, the columns of the last one apply.
            name_columns(group, component)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            said = words(error)
            for name in component.knowledge:
                where = (*path[:2], "knowledge", name)
                if not _is_numeric(group, name):
                    said = f"the knowledge {quoted(name)} is not made of numbers, as many for each agent"
                if f"`{name}`" in said:
                    self._report(
                        "unsuitable",
                        f"{quoted(use)} cannot work with this: {said}",
                        where,
                        expected=component.knowledge[name],
                    )
                    return False
            self._report("unsuitable", f"{quoted(use)} cannot work here: {said}", path, key=True)
            return False
        return True

    def _steps(self, duration: Any, environment: Environment | None) -> int:
        """Return the number of steps of the run; 0 if the duration is invalid, which is already reported."""
        if environment is None or not isinstance(duration, int | float) or not 0 < duration <= 1e9:
            return 0
        steps = math.ceil(nanoseconds(duration) / environment.time_step)
        if steps > _MOST_STEPS:
            self._report(
                "too-long",
                f"the run would take {steps:,} steps of {environment.time_step / 1e9:g} s",
                ("run", "duration"),
                expected=f"at most {_MOST_STEPS:,} steps",
            )
        return max(steps, 1)

    def _simulation(
        self,
        document: ScenarioDocument,
        environment: Environment,
        groups: list[AgentGroup],
        component_entries: list[ComponentEntry],
    ) -> Simulation:
        try:
            return Simulation(
                name=document.name,
                seed=document.seed,
                environment=environment,
                environment_use=document.environment.use,
                groups=groups,
                entries=component_entries,
                obstacles=document.environment.entities,
            )
        except RunError as error:
            cause = error.__cause__
            if isinstance(cause, WorldError):
                for each in (cause, *cause.others):
                    said = f"{quoted(error.plugin)} cannot do this: {words(each)}"
                    self._report("unsuitable", said, each.path, key=True)
            else:
                said = f"{quoted(error.plugin)} cannot set up the world: {error.problem}"
                self._report("unsuitable", said, ("environment",))
            raise ScenarioError(self._problems) from error


def _unresolved(value: Any, path: Path) -> Iterator[Path]:
    """Yield the path of each text that still contains a reference."""
    if isinstance(value, str):
        if "${" in value:
            yield path
        return
    items = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for key, each in items:
        yield from _unresolved(each, (*path, key))


def _fault_of(model: Model | type[Model]) -> str | None:
    """Return the fault in a model's declarations as a predicate; None if they are valid."""
    for name in ("state", "control_input"):
        declared = getattr(model, name, ())
        if not isinstance(declared, Sequence) or not declared or not all(isinstance(x, Quantity) for x in declared):
            return f"declares no `{name}` as quantities"
    indices = [*model.position, *(() if model.heading is None else (model.heading,))]
    if not all(0 <= index < len(model.state) for index in indices):
        return "places its position or heading outside its state"
    if not all(0 <= index < len(model.state) for index in (*model.velocities, *model.angles)):
        return "places its velocities or angles outside its state"
    if len(model.velocities) not in (0, len(model.position)):
        return f"has {len(model.velocities)} velocities for {len(model.position)} coordinates of its position"
    return None


def _is_numeric(group: AgentGroup, name: str) -> bool:
    try:
        return group.known(name).dtype == float
    except (TypeError, ValueError):
        return False
