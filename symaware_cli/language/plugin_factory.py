"""The plugin factory: imports the plugins of a document and instantiates them with validated parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from symaware_cli.core import GroupComponent, Plugin
from symaware_cli.engine import TIMES
from symaware_cli.entry_points import PluginError
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.diagnosis import Diagnosis, leaves_of
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.problem import Problem, dotted, is_inside, quoted
from symaware_cli.language.scenario_section import SECTION
from symaware_cli.language.source import Path
from symaware_cli.language.validation import validate
from symaware_cli.world import FARTHEST, code_position, describe

if TYPE_CHECKING:
    from symaware_cli.engine import Fault


class PluginFactory:
    """Imports the plugins of a document, instantiates them, and reports problems with them.

    Attributes:
        plugins: The class or function that each ``use`` names, by the path of its entry.
        parameters: The paths of all parameters that are valid under ``with``.
        kinds: The class of each kind of faults of the document, by name; None for one that cannot be imported.
        sections: The class of each section that a plugin adds, by key; None for one that cannot be imported.
    """

    def __init__(self, diagnosis: Diagnosis, catalogue: Catalogue, folder: FilePath, is_complete: bool = True) -> None:
        """Prepare.

        Args:
            diagnosis: Has the composed document, and takes problems.
            catalogue: The plugins.
            folder: The folder of the scenario.
            is_complete: Whether the catalogue has all plugins, so that other names are errors.
        """
        self.plugins: dict[Path, Any] = {}
        self.parameters: list[Path] = []
        self.kinds: dict[str, type[Fault] | None] = {}
        self.sections: dict[str, Any] = {}
        self._catalogue = catalogue
        self._folder = folder
        self._is_complete = is_complete
        self._composition = diagnosis.composition
        self._problems = diagnosis.problems
        self._report = diagnosis.report

    def load(self, data: Mapping[str, Any]) -> None:
        """Import every plugin that the document names."""
        self._import("environment", data.get("environment"), ("environment",))
        for place, topology in topologies(data.get("topology")):
            self._import("topology", topology, place)
        for name, entry in mapping(data.get("agents")).items():
            path: Path = ("agents", name)
            self._import("model", mapping(entry).get("model"), (*path, "model"))
            for component, content in mapping(mapping(entry).get("components")).items():
                self._import("component", content, (*path, "components", component))
        for name, fault in mapping(data.get("faults")).items():
            self._import_kinds(mapping(fault), ("faults", name))
        for name, subscriber in mapping(data.get("subscribers")).items():
            self._import("subscriber", subscriber, ("subscribers", name))
        for key, written in data.items():
            self._import_section(key, written)

    def _import_section(self, key: str, written: Any) -> None:
        """Import a section that a plugin adds, and the plugins that it names; other keys are left to the validation."""
        if key in ScenarioDocument.model_fields or not self._catalogue.has(SECTION.name, key):
            return
        try:
            section = self._catalogue.load(SECTION.name, key)
        except PluginError as error:
            self.sections[key] = None
            self._report(error.code, str(error), (key,), key=True, expected=error.expected)
            return
        self.sections[key] = section
        self._catalogue.add(section.uses)
        for kind, place, entry in section.plugins_in(written):
            self._import(kind.name, entry, (key, *place))

    @property
    def installed_sections(self) -> Mapping[str, Any]:
        """The class of each section of the document, by key; None for those that are installed and not used."""
        names = [listing.name for listing in self._catalogue.listings(SECTION.name)]
        return {name: self.sections.get(name) for name in names if name not in ScenarioDocument.model_fields}

    def _import(self, kind: str, entry: Any, path: Path) -> None:
        use = mapping(entry).get("use")
        if not isinstance(use, str):
            return
        try:
            plugin = self._catalogue.load(kind, use)
        except PluginError as error:
            expected = error.expected
            if error.code == "unknown-plugin":
                if not self._is_complete:
                    return
                file = f"{use.partition('.')[0]}.py"
                if "." in use and "/" not in file and (self._folder / file).is_file():
                    expected = f"`plugins: [{file}]` in the scenario, for what that file defines"
            self._report(error.code, str(error), (*path, "use"), expected=expected, suggestion=error.suggestion)
            return
        self.plugins[path] = plugin
        if kind == "subscriber":
            return
        fields = plugin.Parameters.model_fields.items()
        self.parameters += [(*path, "with", field.alias or name) for name, field in fields]

    def _import_kinds(self, fault: Mapping[str, Any], path: Path) -> None:
        """Import the kinds that a fault names by its keys; other keys are left to the validation of the document."""
        for key, content in fault.items():
            if key in TIMES or not self._catalogue.has("fault", key):
                continue
            if key not in self.kinds:
                try:
                    self.kinds[key] = self._catalogue.load("fault", key)
                except PluginError as error:
                    self.kinds[key] = None
                    self._report(error.code, str(error), (*path, key), key=True, expected=error.expected)
            plugin = self.kinds[key]
            if plugin is not None and plugin.component_key:
                self._import("component", content, (*path, key))

    @property
    def installed_kinds(self) -> list[str]:
        """The names of all kinds of faults, sorted; none is imported."""
        return list(dict.fromkeys(listing.name for listing in self._catalogue.listings("fault")))

    def all_kinds(self) -> Mapping[str, type[Fault] | None]:
        """The class of each kind of faults that is installed; None for one that cannot be imported."""
        found = dict(self.kinds)
        for name in self.installed_kinds:
            if name not in found:
                try:
                    found[name] = self._catalogue.load("fault", name)
                except PluginError:
                    found[name] = None
        return found

    def exclude_failing_kinds(self, data: Mapping[str, Any]) -> bool:
        """Set kinds of faults whose parameters raise exceptions to None, and report them; return whether any do."""
        known = dict(self.kinds)
        for name, fault in mapping(data.get("faults")).items():
            for key, content in mapping(fault).items():
                plugin, path = self.kinds.get(key), ("faults", name, key)
                if plugin is None:
                    continue
                try:
                    validate(plugin.Parameters, content, self._composition, path)
                except KeyboardInterrupt:
                    raise
                except BaseException as error:
                    self.kinds[key] = None
                    self._report("broken-plugin", f"the Parameters of {quoted(key)} fail: {words(error)}", path)
        return known != self.kinds

    def instance(self, plugin: type[Plugin], use: str, parameters: BaseModel, path: Path) -> Any:
        """Instantiate a plugin with validated parameters, written at a path; None after a problem."""
        return next(iter(self._instances(plugin, use, parameters, 1, path, path)), None)

    def make(self, entry: Mapping[str, Any], path: Path, count: int = 1) -> list[Any]:
        """Instantiate the plugin of an entry with its parameters; an empty list after a problem.

        A group component is instantiated once, for any count.
        """
        plugin, given = self.plugins.get(path), entry.get("with", {})
        if plugin is None or not isinstance(given, Mapping):
            return []
        use, where = entry["use"], (*path, "with") if "with" in entry else path
        parameters = self._validated(plugin, use, given, where)
        if parameters is None:
            return []
        if isinstance(parameters, list):
            # A parameter written beside `with` is reported as misplaced, not as missing as well.
            self._problems += (
                problem
                for problem in parameters
                if problem.code != "missing-field" or not any(f"`{key}`" in problem.message for key in entry)
            )
            is_component = "components" in path or path[0] == "faults"
            return [] if is_component else self._partial_instance(plugin, given, where, parameters)
        return self._instances(plugin, use, parameters, count, where, (*path, "use"))

    def variants(
        self, entry: Mapping[str, Any], path: Path, given: Mapping[str, Any], where: Path, count: int
    ) -> list[Any]:
        """Instantiate the plugin of an entry with other parameters; an empty list after a problem.

        Args:
            entry: The entry.
            path: Its path.
            given: The parameters.
            where: The place of the parameters that differ from the entry's.
            count: The number of instances.
        """
        plugin = self.plugins.get(path)
        if plugin is None:
            return []
        use = entry["use"]
        parameters = self._validated(plugin, use, given, where)
        if not isinstance(parameters, BaseModel):
            self._problems += parameters or ()
            return []
        return self._instances(plugin, use, parameters, count, where, where)

    def _instances(
        self, plugin: Any, use: str, parameters: BaseModel, count: int, where: Path, named: Path
    ) -> list[Any]:
        """Call a class; `where` is the place of its parameters, `named` that of its name."""
        try:
            return [_instance(plugin, parameters) for _ in range(1 if issubclass(plugin, GroupComponent) else count)]
        except ValueError as error:
            self._report("invalid-value", f"{quoted(use)} refuses its parameters: {words(error)}", where)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._report("broken-plugin", f"{quoted(use)} cannot be made: {words(error)}", named)
        return []

    def _validated(
        self, plugin: Any, use: str, given: Mapping[str, Any], where: Path
    ) -> BaseModel | list[Problem] | None:
        """Validate the parameters of a plugin, given under ``with``.

        Returns:
            The parameters, or every problem with them; None after a problem that is already reported.
        """
        leaves = leaves_of(given, where)
        far = [(place, each) for place, each in leaves if isinstance(each, float) and not abs(each) <= FARTHEST]
        for place, number in far:
            said, expected = f"{quoted(dotted(place))} is {number:g}", f"a number from {-FARTHEST:g} to {FARTHEST:g}"
            self._report("out-of-range", said, place, expected=expected)
        if far:
            return None
        try:
            return validate(plugin.Parameters, given, self._composition, where)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._report("broken-plugin", f"the Parameters of {quoted(use)} fail: {words(error)}", where)
            return None

    def _partial_instance(
        self, plugin: type[Plugin], given: Mapping[str, Any], where: Path, problems: Iterable[Problem]
    ) -> list[Any]:
        """Create an instance without the invalid parameters, so that objects that depend on it can still be checked.

        The scenario is rejected anyway. There is no instance if other objects depend on an invalid parameter.
        """
        wrong = {key for key in given for each in problems if is_inside(each.path, dotted((*where, key)))}
        if "time_step" in wrong:
            return []
        parameters = validate(
            plugin.Parameters, {key: given[key] for key in given if key not in wrong}, self._composition, where
        )
        if isinstance(parameters, list):
            return []
        try:
            return [_instance(plugin, parameters)]
        except KeyboardInterrupt:
            raise
        except BaseException:
            return []


def _instance(plugin: type[Plugin], parameters: BaseModel) -> Plugin:
    """Instantiate a plugin with its own copy of parameters, so that agents share no mutable values.

    A class that declares no parameters is called without arguments.
    """
    own = parameters.model_copy(deep=True)
    instance = plugin() if plugin.Parameters is Plugin.Parameters else plugin(own)
    # For one whose `__init__` does not call that of its base.
    vars(instance).setdefault("parameters", own)
    return instance


def topologies(entry: Any) -> Iterator[tuple[Path, Mapping[str, Any]]]:
    """Yield each topology that a section names, with its path."""
    yield ("topology",), mapping(entry)
    changes = mapping(entry).get("changes")
    for number, each in enumerate(changes if isinstance(changes, list) else ()):
        yield ("topology", "changes", number), mapping(each)


def mapping(value: Any) -> Mapping[str, Any]:
    """Return a value if it is a mapping, otherwise an empty mapping."""
    return value if isinstance(value, Mapping) else {}


def words(error: BaseException) -> str:
    """Describe an exception: the text of a `ValueError`; of others also the type and the position in the code."""
    text = describe(error)
    if isinstance(error, ValueError | NotImplementedError) and ": " in text:
        return text.partition(": ")[2]
    return text + code_position(error)
