"""Builds the sections of a scenario that plugins add."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path as FilePath
from typing import Any

from symaware_cli.core import Plugin
from symaware_cli.engine import Simulation
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.plugin_factory import PluginFactory, mapping, words
from symaware_cli.language.problem import Problem, quoted
from symaware_cli.language.scenario_section import ScenarioSection, SectionContext
from symaware_cli.language.source import Path


class SectionBuilder:
    """Builds the sections of a scenario that plugins add, and reports problems with them.

    Attributes:
        built: The object built from each section, by key.
    """

    def __init__(self, diagnosis: Diagnosis, factory: PluginFactory) -> None:
        """Prepare.

        Args:
            diagnosis: Takes problems.
            factory: Has the classes of the sections, and creates plugins.
        """
        self._diagnosis = diagnosis
        self._factory = factory
        self._sections: dict[str, ScenarioSection] = {}
        self._parameters: dict[Path, Mapping[str, Any]] = {}
        self.built: dict[str, Any] = {}

    def build(self, data: Mapping[str, Any], document: ScenarioDocument | None, folder: FilePath) -> None:
        """Build each section.

        Args:
            data: The whole scenario as plain data.
            document: The validated document; None if it is invalid.
            folder: The folder of the scenario.
        """
        for key, kind in self._factory.sections.items():
            if kind is None:
                continue
            for _, place, entry in kind.plugins_in(data[key]):
                self._parameters[key, *place] = mapping(mapping(entry).get("with"))
            context = _Context(key, document, folder, self._factory, self._diagnosis)
            try:
                section = kind()
                self.built[key] = section.build(data[key], context)
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                if document is not None:
                    context.report(f"the section {quoted(key)} fails: {words(error)}", key=True, code="broken-plugin")
            else:
                self._sections[key] = section

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
        folder: FilePath,
        factory: PluginFactory,
        diagnosis: Diagnosis,
    ) -> None:
        self.document = document
        self.folder = folder
        self.regions = {} if document is None else document.regions
        self._key = key
        self._factory = factory
        self._diagnosis = diagnosis

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
