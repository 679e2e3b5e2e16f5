"""Builds the sections of a scenario that plugins add."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from symaware_cli.assets import AssetFolders
from symaware_cli.core import Plugin
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.plugin_factory import PluginFactory, mapping, words
from symaware_cli.language.problem import Problem, quoted
from symaware_cli.language.scenario_section import Additions, InitialAgents, ScenarioSection, SectionContext
from symaware_cli.language.source import Path

if TYPE_CHECKING:
    from symaware_cli.core import Obstacle
    from symaware_cli.engine import Simulation
    from symaware_cli.geometry import Region


class SectionBuilder:
    """Builds the sections of a scenario that plugins add, and reports problems with them.

    Attributes:
        built: The object built from each section, by key.
        files: The files that were read for additions of sections, by their paths relative to the scenario's folder.
        drawn: The keys of the sections whose additions differ between runs.
        areas: The areas of the additions [m], [x, x, y, y].
        free: The names of the regions that contain the agents placed in free space.
    """

    def __init__(
        self,
        diagnosis: Diagnosis,
        factory: PluginFactory,
        folders: AssetFolders,
        agents: Callable[[], Sequence[InitialAgents]],
    ) -> None:
        """Prepare.

        Args:
            diagnosis: Takes problems.
            factory: Has the classes of the sections, and creates plugins.
            folders: The folders of the scenario.
            agents: Returns the agents of each group at the beginning; for a valid document.
        """
        self._diagnosis = diagnosis
        self._factory = factory
        self._folders = folders
        self._agents = agents
        self._sections: dict[str, ScenarioSection] = {}
        self._parameters: dict[Path, Mapping[str, Any]] = {}
        #: The keys of sections of which a step failed.
        self._failed: list[str] = []
        self.built: dict[str, Any] = {}
        self.drawn: list[str] = []
        self.areas: list[tuple[float, float, float, float]] = []
        self.free: list[str] = []

    def build(self, data: Mapping[str, Any], document: ScenarioDocument | None) -> ScenarioDocument | None:
        """Build each section.

        Args:
            data: The whole scenario as plain data.
            document: The validated document; None if it is invalid.

        Returns:
            The document with the additions of sections.
        """
        sections: dict[str, ScenarioSection] = {}
        added: dict[str, Additions] = {}
        for key, kind in self._factory.sections.items():
            if kind is None:
                continue
            for _, place, entry in kind.plugins_in(data[key]):
                self._parameters[key, *place] = mapping(mapping(entry).get("with"))
            section = self._attempt(key, document, kind)
            if section is None:
                continue
            sections[key] = section
            if document is not None:
                found = self._attempt(key, document, section.additions, data[key])
                if found is None:
                    del sections[key]
                else:
                    added[key] = found
        # In the order of keys, so that the order of sections in the file does not matter.
        document = document and self._extended(document, {key: added[key] for key in sorted(added)})
        for key, section in sections.items():
            failures = len(self._failed)
            built = self._attempt(key, document, section.build, data[key])
            if len(self._failed) == failures:
                self.built[key] = built
                self._sections[key] = section
        return document

    def _attempt(self, key: str, document: ScenarioDocument | None, step: Callable[..., Any], *given: Any) -> Any:
        """Call a step of building a section, with the context if it has arguments; None if it fails."""
        context = _Context(key, document, self._folders, self._factory, self._diagnosis, self._agents)
        try:
            return step(*given, context) if given else step()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._failed.append(key)
            if document is not None:
                context.report(f"the section {quoted(key)} fails: {words(error)}", key=True, code="broken-plugin")
            return None

    def _extended(self, document: ScenarioDocument, added: Mapping[str, Additions]) -> ScenarioDocument:
        """Return the document with the additions of sections, and report names that are taken."""
        entities: dict[str, Obstacle] = dict(document.environment.entities)
        regions: dict[str, Region] = dict(document.regions)
        owners = {name: f"the {kind}" for kind, names in (("entity", entities), ("region", regions)) for name in names}
        owners |= dict.fromkeys(document.agents, "the group")
        for key, additions in added.items():
            if additions.is_drawn:
                self.drawn.append(key)
            self.areas += [] if additions.bounds is None else [additions.bounds]
            self.free += [] if additions.free is None else [additions.free]
            for kind, found in (("entities", additions.entities), ("regions", additions.regions)):
                taken = [name for name in found if name in owners]
                if taken:
                    said = f"{quoted(key)} adds {kind} with names that are taken: {owners[taken[0]]} {quoted(taken[0])}"
                    self._diagnosis.report("unsuitable", said, (key,), key=True)
            entities |= {name: each for name, each in additions.entities.items() if name not in owners}
            regions |= {name: each for name, each in additions.regions.items() if name not in owners}
            owners |= {name: f"that of {quoted(key)}," for name in (*additions.entities, *additions.regions)}
            self._diagnosis.place_at(("environment", "entities"), additions.entities, (key,))
            self._diagnosis.place_at(("regions",), additions.regions, (key,))
        document = self._stated(document, added)
        if entities.keys() == document.environment.entities.keys() and regions.keys() == document.regions.keys():
            return document
        environment = document.environment.model_copy(update={"entities": entities})
        return document.model_copy(update={"environment": environment, "regions": regions})

    def _stated(self, document: ScenarioDocument, added: Mapping[str, Additions]) -> ScenarioDocument:
        """Return the document with the specifications that sections add, and report names that are taken."""
        found = dict(document.specifications)
        owners = dict.fromkeys(found, "the specification")
        for key, additions in added.items():
            for name in additions.specifications.keys() & owners.keys():
                said = f"{quoted(key)} adds a specification whose name is taken: {owners[name]} {quoted(name)}"
                self._diagnosis.report("unsuitable", said, (key, name), key=True)
            found |= {name: each for name, each in additions.specifications.items() if name not in owners}
            owners |= dict.fromkeys(additions.specifications, f"that of {quoted(key)},")
            for name in additions.specifications:
                self._diagnosis.move(("specifications", name), (key, name))
        if found.keys() == document.specifications.keys():
            return document
        return document.model_copy(update={"specifications": found})

    def parameters(self) -> Mapping[Path, Mapping[str, Any]]:
        """Return the parameters of the plugins that entries of the sections name, by the paths of the entries."""
        return self._parameters

    def plugins(self) -> Mapping[Path, Plugin]:
        """Return the plugins that check the whole scenario, by their paths."""
        return {
            (key, *place): plugin
            for key, section in self._sections.items()
            for place, plugin in section.plugins(self.built[key]).items()
        }

    def files(self) -> Mapping[str, bytes]:
        """Return the files that the sections read, besides those that plugins name in parameters."""
        return {
            name: content
            for key, section in self._sections.items()
            for name, content in section.files(self.built[key]).items()
        }

    def connect(self, simulation: Simulation) -> None:
        """Connect the built objects with the simulation."""
        for key, section in self._sections.items():
            section.connect(self.built[key], simulation)


class _Context(SectionContext):
    def __init__(
        self,
        key: str,
        document: ScenarioDocument | None,
        folders: AssetFolders,
        factory: PluginFactory,
        diagnosis: Diagnosis,
        agents: Callable[[], Sequence[InitialAgents]],
    ) -> None:
        self.document = document
        self.folder = folders.home
        self.folders = folders
        self.regions = {} if document is None else document.regions
        self._key = key
        self._factory = factory
        self._diagnosis = diagnosis
        self._agents = agents

    def agents(self) -> Sequence[InitialAgents]:
        return [] if self.document is None else self._agents()

    def make(self, entry: Any, *place: str | int) -> Plugin | None:
        written = entry if isinstance(entry, Mapping) else {}
        return next(iter(self._factory.make(written, (self._key, *place))), None)

    def report(
        self,
        message: str,
        *place: str | int,
        key: bool = False,
        code: str = "unsuitable",
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        where = (self._key, *place)
        self._diagnosis.report(code, message, where, key=key, expected=expected, suggestion=suggestion)

    def add(self, problems: Iterable[Problem]) -> None:
        self._diagnosis.problems.extend(problems)
