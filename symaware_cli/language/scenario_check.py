"""Lets each plugin of a scenario check the whole scenario, and locates the reported problems in the files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from symaware_cli.core import AgentGroup, EntryView, Environment, Links, Plugin, ScenarioView
from symaware_cli.core.component import BaseComponent
from symaware_cli.engine import ComponentEntry
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.plugin_factory import mapping, words
from symaware_cli.language.problem import quoted
from symaware_cli.language.source import Path
from symaware_cli.world import ParameterError, record

if TYPE_CHECKING:
    from symaware_cli.specification import Specification


@record
class ScenarioFacts:
    """The parts of a scenario that plugins can check; see `ScenarioView`."""

    document: ScenarioDocument
    environment: Environment
    groups: Sequence[AgentGroup]
    entries: Sequence[ComponentEntry]
    specifications: Mapping[str, Specification]
    links: Links | None
    network_changes: bool
    steps: int


class ScenarioCheck:
    """Lets plugins check a scenario."""

    def __init__(self, facts: ScenarioFacts, plugins: Mapping[Path, Plugin], diagnosis: Diagnosis) -> None:
        """Prepare.

        Args:
            facts: The scenario.
            plugins: One instance of each plugin except components, by the path of its section.
            diagnosis: Takes problems and warnings.
        """
        self._facts = facts
        self._plugins = plugins
        self._diagnosis = diagnosis

    def check(self, *, is_initialised: bool) -> None:
        """Let each plugin check the scenario, and report its problems.

        A plugin may raise a `ValueError` instead of reporting it. It is located at the plugin's section, or at the
        first of the specifications the plugin names that is mentioned in backquotes.

        Args:
            is_initialised: See `ScenarioView`.
        """
        are_sound = not self._diagnosis.problems
        for plugin, view in self._views(is_initialised):
            try:
                plugin.check_scenario(view)
            except ParameterError as error:
                view.report(str(error), "with", *error.place, key=False)
            except ValueError as error:
                view.report(str(error), *_place_named(view, str(error)), key=False)
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                # Where the scenario has other problems, this may be a consequence of one.
                if are_sound:
                    said = f"{quoted(view.use)} cannot check the scenario: {words(error)}"
                    view.report(said, "use", key=False, code="broken-plugin")

    def find_warnings(self) -> None:
        """Collect the warnings of plugins."""
        for plugin, view in self._views(True):
            plugin.find_warnings(view)

    def _views(self, is_initialised: bool) -> Iterable[tuple[Plugin, _View]]:
        for path, plugin in self._plugins.items():
            yield plugin, _View(self._facts, is_initialised, path, None, self._diagnosis)
        for entry in self._facts.entries:
            for component, parameters in entry.variations:
                seen = entry if component is entry.components[0] else _Single(entry, component)
                view = _View(self._facts, is_initialised, entry.section, seen, self._diagnosis, parameters)
                yield component, view


def _place_named(view: _View, said: str) -> Path:
    """Return the place below the plugin's section of the first specification that a message mentions."""
    component = None if view.entry is None else view.entry.components[0]
    if component is None or component.specifications is None:
        return ()
    names = getattr(component.parameters, component.specifications)
    place = next((place for place, name in enumerate(names) if f"`{name}`" in said), None)
    return ("with", component.specifications, *(() if place is None else (place,)))


class _Single:
    """An entry as seen by an agent with parameters of its own: that of others, with this agent's component alone."""

    def __init__(self, entry: ComponentEntry, component: BaseComponent[Any]) -> None:
        self.group, self.name, self.use = entry.group, entry.name, entry.use
        self.components = (component,)
        self.section, self.timing = entry.section, entry.timing


class _View(ScenarioView):
    def __init__(
        self,
        facts: ScenarioFacts,
        is_initialised: bool,
        section: Path,
        entry: EntryView | None,
        diagnosis: Diagnosis,
        parameters: Path = (),
    ) -> None:
        self.document = facts.document
        self.environment = facts.environment
        self.is_initialised = is_initialised
        self.groups = facts.groups
        self.entries = facts.entries
        self.specifications = facts.specifications
        self.links, self.network_changes = facts.links, facts.network_changes
        self.steps = facts.steps
        self.section = section
        self.entry = entry
        self._diagnosis = diagnosis
        self._parameters = parameters

    @property
    def use(self) -> str:
        """The entry-point name of the plugin."""
        if self.section[0] == "faults" and self.entry is None:
            return str(self.section[-1])
        written: Any = self._diagnosis.composition.data
        for key in self.section:
            written = written[key]
        return str(mapping(written).get("use", ".".join(map(str, self.section))))

    def report(
        self,
        message: str,
        *place: str | int,
        section: Path | None = None,
        key: bool = True,
        code: str = "unsuitable",
        expected: str | None = None,
    ) -> None:
        self._diagnosis.report(code, message, self._path(place, section), key=key, expected=expected)

    def report_unknown(self, kind: str, name: str, *place: str | int, known: Iterable[str]) -> None:
        self._diagnosis.report_unknown(kind, name, self._path(place, None), known)

    def warn(
        self,
        message: str,
        *place: str | int,
        section: Path | None = None,
        key: bool = False,
        code: str = "reservation",
        expected: str | None = None,
    ) -> None:
        self._diagnosis.warn(code, message, self._path(place, section), key=key, expected=expected)

    def _path(self, place: Path, section: Path | None) -> Path:
        """The path of a place, or of the section if the scenario does not write anything there."""
        whole = (*(self.section if section is None else section), *place)
        if self._parameters and section is None and place[:1] == ("with",):
            own = (*self._parameters, *place[1:])
            whole = own if self._diagnosis.composition.has(own) else whole
        if self._diagnosis.composition.has(whole):
            return whole
        return self.section if section is None else section
