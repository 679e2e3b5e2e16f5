"""Builds a simulation from a composed document: validates it, loads plugins, creates groups and components."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from symaware_cli.assets.asset import AssetFolders
from symaware_cli.core import AgentGroup, Environment, Links, Plugin, WorldError, nanoseconds
from symaware_cli.engine import ComponentEntry, RunError, RunOptions, Simulation
from symaware_cli.language.assets import asset_folders, assets, check_assets
from symaware_cli.language.body_check import check_bodies
from symaware_cli.language.capable_worlds import expected_world, with_other_worlds
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.changes import Changes
from symaware_cli.language.compose import Composition, CompositionError, compose
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument, document_of
from symaware_cli.language.free_places import FreeRoom, around
from symaware_cli.language.group_builder import GroupBuilder, is_placed
from symaware_cli.language.own_plugins import with_own_plugins
from symaware_cli.language.parts import check_omitted
from symaware_cli.language.plugin_factory import PluginFactory, mapping, topologies, words
from symaware_cli.language.problem import Problem, ScenarioError, is_inside, quoted
from symaware_cli.language.requirement import check_requirements
from symaware_cli.language.resolved import resolved
from symaware_cli.language.scenario_check import ScenarioCheck, ScenarioFacts
from symaware_cli.language.scenario_section import InitialAgents
from symaware_cli.language.section_builder import SectionBuilder
from symaware_cli.language.source import Path
from symaware_cli.language.timing_check import TimingCheck
from symaware_cli.language.validation import validate
from symaware_cli.world import record

if TYPE_CHECKING:
    from symaware_cli.engine import Network, Topology
    from symaware_cli.language.topology_section import TopologyUse

#: The greatest number of steps; more are taken for a mistake: at a million steps per second they take 17 minutes.
_MOST_STEPS = 10**9

#: Sections in which an entry can be checked where another one is wrong.
_INDEPENDENT = ("faults", "specifications")


@record
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
        sections: The objects built from the sections of plugins, by key.
        section_files: The names of the files, of these, that sections of plugins read for their additions.
        drawn_sections: The keys of the sections that add other bodies or regions in each run.
        find_warnings: Returns warnings about valid but probably unintended values; too slow for the start of a run.
    """

    document: ScenarioDocument
    simulation: Simulation
    steps: int
    options: RunOptions
    data: Mapping[str, Any]
    files: Mapping[str, bytes]
    uses: Mapping[str, Mapping[str, Any]]
    sections: Mapping[str, Any] = field(default_factory=dict)
    section_files: Sequence[str] = ()
    drawn_sections: Sequence[str] = ()
    find_warnings: Callable[[], Sequence[Problem]] = tuple

    @property
    def resolved(self) -> bytes:
        """The resolved document as YAML, written at each access; running it repeats the run."""
        return resolved(self.data, self.document)

    @property
    def digest(self) -> bytes:
        """The SHA-256 of the resolved document, and of the scenario's own plugins and maps; identifies the scenario."""
        content = [self.resolved, *(self.files[name] for name in sorted(self.section_files))]
        if self.document.plugins:
            content += [self.files[name] for name in sorted(self.files) if name.endswith(".py")]
        return hashlib.sha256(b"\0".join(content)).digest()


def build(
    path: FilePath,
    changes: Changes | None = None,
    seed: int | None = None,
    catalogue: Catalogue | None = None,
    name: str | None = None,
    world: Callable[[Environment], Environment] | None = None,
    statements: FilePath | None = None,
) -> Built:
    """Read a scenario and create all its objects, without running it.

    Args:
        path: The scenario file.
        changes: Values that replace those of the file, as for ``--set``.
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
        composition = compose(path, changes, name, statements)
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
    known = catalogue or Catalogue()

    def builds(other: str) -> bool:
        """Whether the scenario can be built with another world."""
        changed = composition.copy()
        if not isinstance(changed.data.get("environment"), dict):
            return False
        changed.data["environment"]["use"] = other
        try:
            built = _SimulationBuilder(changed, known, found, folder, None).build()
        except ScenarioError:
            return False
        built.simulation.environment.close()
        return True

    try:
        return _SimulationBuilder(composition, known, found, folder, world).build()
    except ScenarioError as error:
        further = with_other_worlds(error, known, builds)
        if further is error:
            raise
        raise further from error


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
        self._diagnosis = Diagnosis(composition, found)
        self._problems, self._report = self._diagnosis.problems, self._diagnosis.report
        catalogue, own_files = with_own_plugins(catalogue, self._diagnosis, folder)
        self._own_files, self._catalogue = own_files or {}, catalogue
        self._factory = PluginFactory(self._diagnosis, catalogue, folder, is_complete=own_files is not None)
        #: Whether a fault limits the bandwidth of links.
        self._narrowed = False

    def build(self) -> Built:
        data = self._composition.data
        self._factory.load(data)
        document = self._document(data)
        if isinstance(document, list):
            if any(problem.code == "wrong-version" for problem in document):
                # Other problems are meaningless in another version of the format.
                raise ScenarioError([problem for problem in document if problem.code == "wrong-version"])
            self._problems.extend(document)
            document = self._sound_part(data, document)
        # Objects are created even if the document has problems elsewhere, so that one pass reports everything.
        valid = document if isinstance(document, ScenarioDocument) else None
        folders = AssetFolders(self._folder)
        if valid is not None:
            folders = asset_folders(valid, self._folder)
        environment = self._environment(mapping(data.get("environment")), folders)

        def initial_agents() -> Sequence[InitialAgents]:
            # Their problems are reported when the groups are built.
            unheard = Diagnosis(self._composition)
            maker = GroupBuilder(unheard, self._factory, valid, self._folder)
            return maker.initial_agents(mapping(data.get("agents")))

        sections = SectionBuilder(self._diagnosis, self._factory, folders, initial_agents)
        extended = sections.build(data, valid)
        if extended is not None:
            valid = document = extended
        maker = GroupBuilder(self._diagnosis, self._factory, valid, self._folder)
        maker.sections = sections.built
        if valid is not None and any(is_placed(mapping(entry)) for entry in mapping(data.get("agents")).values()):
            maker.space = FreeRoom(
                valid.seed,
                valid.environment.entities,
                valid.regions,
                around(sections.areas),
                sections.free,
                initial_agents(),
            )
        groups, component_entries = [], []
        # In the order of the roster from here on, so that the order of groups in the file does not matter.
        for name, entry in sorted(mapping(data.get("agents")).items()):
            group, own_entries = maker.build(name, mapping(entry))
            if group:
                groups.append(group)
            component_entries += own_entries
        steps = self._steps(mapping(data.get("run")).get("duration"), environment)
        networks = self._topologies(data.get("topology"))
        check_omitted(mapping(data.get("recording")).get("omit"), maker.declared, self._diagnosis)
        options, network, links = RunOptions(), None, None
        if isinstance(document, ScenarioDocument) and environment is not None:
            options = self._options(document, environment, groups, component_entries)
            check_requirements(document, environment, groups, component_entries, self._diagnosis, self._catalogue)
            check_assets(document, sections.parameters(), environment, folders, self._diagnosis)
            if document.topology is not None and len(groups) == len(document.agents):
                network, links = self._network(document.topology, networks, document, environment, groups)
        if isinstance(document, list) or environment is None:
            self._diagnosis.raise_problems()
        facts = ScenarioFacts(
            document=document,
            environment=environment,
            groups=groups,
            entries=component_entries,
            specifications={each.name: each for each in options.specifications},
            links=links,
            network_changes=network is not None and links is None,
            steps=steps,
        )
        plugins: dict[Path, Plugin] = {
            ("environment",): environment,
            **{("agents", group.name, "model"): group.model for group in groups},
            **networks,
            **sections.plugins(),
            **{("faults", fault.name, fault.kind): fault for fault in options.faults},
        }
        check = ScenarioCheck(facts, plugins, self._diagnosis)
        if self._problems or self._diagnosis.earlier:
            check.check(is_initialised=False)
            self._diagnosis.raise_problems()
        simulation = self._simulation(document, environment, groups, component_entries)
        if options.specifications:
            from symaware_cli.language.specifications import check_values

            check_values(options.specifications, self._diagnosis)
        # A world in place of the scenario's is for a scenario that was built with its own before.
        check.check(is_initialised=self._world is None)
        if self._problems:
            raise ScenarioError(self._problems)
        if network is not None:
            simulation.connect(network)
        # A log that is read fires the events of its run again, which subscribers were told of by the run.
        for name, use in document.subscribers.items() if self._world is None else ():
            simulation.events.subscribe_matching(use.event, self._factory.plugins["subscribers", name], use.of)
        sections.connect(simulation)
        assets_needed = assets(document, sections.parameters(), folders)
        section_files = sections.files()
        files = {**self._composition.files, **self._own_files, **assets_needed, **section_files}

        def find_warnings() -> Sequence[Problem]:
            check.find_warnings()
            step = environment.time_step
            if options.specifications:
                from symaware_cli.language.satisfiability_check import check_satisfiable

                check_satisfiable(options.specifications, options.instances, steps * step, step, self._diagnosis)
            check_bodies(document, groups, self._diagnosis)
            return tuple(self._diagnosis.warnings)

        return Built(
            document=document,
            simulation=simulation,
            steps=steps,
            options=options,
            data=data,
            files=files,
            uses=maker.uses,
            sections=sections.built,
            section_files=tuple(section_files),
            drawn_sections=tuple(sections.drawn),
            find_warnings=find_warnings,
        )

    def _sound_part(self, data: Mapping[str, Any], problems: list[Problem]) -> ScenarioDocument | list[Problem]:
        """The document without its wrong entries, if these are in sections whose entries do not need each other."""
        wrong = {tuple(problem.path.split(".")[:2]) for problem in problems}
        if not all(len(each) == 2 and each[0] in _INDEPENDENT for each in wrong):
            return problems
        rest = {**data}
        for section, name in wrong:
            rest[section] = {key: entry for key, entry in rest[section].items() if key != name}
        return self._document(rest)

    def _document(self, data: Mapping[str, Any]) -> ScenarioDocument | list[Problem]:
        """Validate the document; the kinds of faults that it does not use are only imported for suggestions."""
        factory = self._factory
        installed = factory.installed_kinds if data.get("faults") else []
        sections = factory.installed_sections
        try:
            document = self._validated(document_of(factory.kinds, installed, sections, data), data)
        except Exception:
            if not factory.exclude_failing_kinds(data):
                raise
            document = self._validated(document_of(factory.kinds, installed, sections, data), data)
        if isinstance(document, list):
            # Messages are about the whole model: they name other keys, and where else a key is valid.
            has_wrong_faults = any(is_inside(problem.path, "faults") for problem in document)
            kinds = factory.all_kinds() if has_wrong_faults else factory.kinds
            document = self._validated(document_of(kinds, installed, sections), data)
        return document

    def _validated(self, model: type[ScenarioDocument], data: Mapping[str, Any]) -> ScenarioDocument | list[Problem]:
        return validate(model, data, self._composition, (), self._factory.parameters)

    def _options(
        self,
        document: ScenarioDocument,
        environment: Environment,
        groups: Sequence[AgentGroup],
        component_entries: list[ComponentEntry],
    ) -> RunOptions:
        """Build the options of the run, set the timing of the components, and add those that replace others."""
        written = mapping(self._composition.data.get("specifications"))
        named = {**written, **document.specifications}
        check = TimingCheck(self._diagnosis, environment, document.regions, named, document.environment.entities)
        for component_entry in component_entries:
            use = document.agents[component_entry.group.name].components[component_entry.name]
            kind, path = type(component_entry.components[0]), component_entry.section
            component_entry.timing = check.timing(use, component_entry.group, kind, path)
        check.triggers(component_entries)
        run = document.run
        options = RunOptions(
            mode=run.mode, until=check.until(run, groups), pace=run.pace, turn_limit=run.turn_limit, workers=run.workers
        )
        if len(groups) < len(document.agents):
            return options
        # What a scenario does not use is not imported.
        if document.faults:
            from symaware_cli.language.fault_builder import FaultBuilder

            faults = FaultBuilder(check, environment, groups, component_entries, document, self._factory)
            self._narrowed = any(each is not None and each.limits_bandwidth for each in faults.declared.values())
            options = replace(options, faults=tuple(faults.build()))
        if any(each.present is not None for each in document.agents.values()):
            from symaware_cli.language.presence_builder import PresenceBuilder

            members = PresenceBuilder(check, environment, document.environment.use, component_entries, document.seed)
            options = replace(options, presence=members.build(groups, document.agents))
        named_by = [each for each in component_entries if each.components[0].specifications is not None]
        if document.specifications or document.regions or named_by:
            from symaware_cli.language.specifications import SpecificationBuilder

            statements = SpecificationBuilder(check, environment, groups, component_entries)
            options = replace(options, specifications=statements.build(document), instances=statements.triggers)
        return options

    def _network(
        self,
        use: TopologyUse,
        topologies: Mapping[Path, Topology],
        document: ScenarioDocument,
        environment: Environment,
        groups: Sequence[AgentGroup],
    ) -> tuple[Network | None, Links | None]:
        """Return the network, None after a problem; and its links if they are fixed."""
        from symaware_cli.language.network_builder import NetworkBuilder

        builder = NetworkBuilder(self._diagnosis, environment, groups, document.seed)
        network = builder.build(use, topologies, narrowed=self._narrowed)
        if network is None:
            return None, None
        is_fixed = not use.changes and not network.phase(0).topology.changes
        return network, builder.links(network) if is_fixed else None

    def _environment(self, entry: Mapping[str, Any], folders: AssetFolders) -> Environment | None:
        made = self._factory.make(entry, ("environment",))
        if not made:
            return None
        environment: Environment = made[0]
        step = getattr(environment, "time_step", None)
        if not isinstance(step, int) or step < 1:
            self._report("broken-plugin", f"{quoted(entry['use'])} has no time step", ("environment", "use"))
            return None
        environment.folder, environment.further_folders = folders.home, folders.further
        return environment if self._world is None else self._world(environment)

    def _topologies(self, entry: Any) -> dict[Path, Topology]:
        """Create every topology of the section, by its path."""
        made = {path: self._factory.make(each, path) for path, each in topologies(entry)}
        return {path: instances[0] for path, instances in made.items() if instances}

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
                    needs = getattr(each, "needs", None)
                    expected = expected_world(needs, self._catalogue) if needs else None
                    self._report("unsuitable", said, each.path, key=True, expected=expected)
            else:
                said = f"{quoted(error.plugin)} cannot set up the world: {error.problem}"
                self._report("unsuitable", said, ("environment",))
            raise ScenarioError(self._problems) from error
