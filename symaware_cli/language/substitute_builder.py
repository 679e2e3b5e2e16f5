"""Creates components that take the place of others while a fault lasts, and checks that they fit there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

from symaware_cli.core import AgentGroup, Component, GroupComponent
from symaware_cli.core.component import BaseComponent
from symaware_cli.engine import ComponentEntry, ComponentSelection
from symaware_cli.language.diagnosis import ReportedError
from symaware_cli.language.document import ScenarioDocument
from symaware_cli.language.group_builder import ComponentCheck
from symaware_cli.language.own_parameters import parameters_of
from symaware_cli.language.parts import declared_signals
from symaware_cli.language.plugin_factory import PluginFactory, mapping
from symaware_cli.language.problem import quoted
from symaware_cli.language.source import Path
from symaware_cli.language.timing_check import TimingCheck


class SubstituteBuilder:
    """Creates components in place of others; a problem is reported, and a `ReportedError` raised."""

    def __init__(self, factory: PluginFactory, timing_check: TimingCheck, document: ScenarioDocument) -> None:
        """Prepare.

        Args:
            factory: Creates components.
            timing_check: Checks the times of turns, and takes problems.
            document: The validated document.
        """
        self._diagnosis = timing_check.diagnosis
        self._data = self._diagnosis.composition.data
        self._factory = factory
        self._timing_check = timing_check
        self._component_check = ComponentCheck(self._diagnosis)
        self._document = document

    def build(
        self, selected: ComponentSelection, path: Path, changed: Mapping[str, Any] | None = None, where: Path = ()
    ) -> ComponentEntry:
        """Create a component in place of another one, and check that it can work there.

        Args:
            selected: The components that it takes the place of.
            path: The path of the section that names it: ``faults``, the name of a fault, and the key of its kind.
            changed: The parameters that change, of a component of the same use; None if the section names the use.
            where: Where these are written.
        """
        entry, group = selected.entry, selected.entry.group
        fault, key = str(path[1]), str(path[2])
        section = mapping(self._data["agents"][group.name])
        if changed is None:
            written = mapping(self._data["faults"][fault][key])
            use, made = str(written["use"]), self._factory.make(written, path, len(group))
        else:
            written, use = mapping(section["components"][entry.name]), entry.use
            given = {**parameters_of(written, selected.rows[0]), **changed}
            made = self._factory.variants(written, entry.section, given, where, len(group))
        if not made:
            raise ReportedError
        first: Component | GroupComponent = made[0]
        if not self._component_check.knows(first, section.get("knowledge", {}), path, group.name, use):
            raise ReportedError
        self._check_place(entry, first, selected, use, path)
        self._declare(group, entry.name, first, use, path)
        if not self._component_check.can_work(group, first, path, use):
            raise ReportedError
        turns = self._document.agents[group.name].components[entry.name]
        timing = self._timing_check.timing(turns, group, type(first), path)
        return ComponentEntry(group, entry.name, use, made, timing, path)

    def _check_place(
        self,
        entry: ComponentEntry,
        component: Component | GroupComponent,
        selected: ComponentSelection,
        use: str,
        path: Path,
    ) -> None:
        """Check that a component can take the turns and the messages of another one during the run."""
        if entry.timing.in_process:
            self._refuse(f"{quoted(entry.name)} runs in a process of its own, where it cannot be replaced", path)
        substitute = ComponentEntry(entry.group, entry.name, use, [component])
        if not substitute.listens:
            return
        shares = isinstance(component, GroupComponent)
        if (
            not entry.listens
            or entry.kinds != substitute.kinds
            or isinstance(entry.components[0], GroupComponent) != (shares)
        ):
            kinds = "messages" if substitute.kinds is None else f"messages {', '.join(sorted(substitute.kinds))}"
            self._refuse(f"{quoted(use)} reads {kinds}, which {quoted(entry.use)} does not read in this way", path)
        if shares and len(selected.rows) < len(entry.group):
            self._refuse(f"{quoted(use)} reads the messages to all of {quoted(entry.group.name)} at once", path)

    def _declare(self, group: AgentGroup, name: str, component: BaseComponent[Any], use: str, path: Path) -> None:
        """Add a component's new signals to its group; its other signals, parts and columns must be declared already."""
        awareness = group.awareness
        for part in component.parts:
            if awareness.parts.get(part.name) != part:
                said = f"{quoted(use)} writes the part {quoted(part.name)}, which the agents of {quoted(group.name)}"
                self._refuse(f"{said} do not have before", path)
        # The last name of a path is taken for that of the component.
        signals = declared_signals([(component, use, (*path, name))], self._diagnosis)
        for field, signal in signals.items():
            if awareness.signals.get(field, signal) != signal:
                said = f"{quoted(use)} and the component that it replaces declare different signals"
                self._refuse(f"{said} {quoted(signal.name)}", path)
        awareness.declare({field: each for field, each in signals.items() if field not in awareness.signals})
        columns = component.series_quantities(group)
        for series, quantities in columns.items() if isinstance(columns, dict) else ():
            before = awareness.parts[series].columns if series in awareness.parts else None
            if before is not None and tuple(before) != tuple(quantities):
                names = ", ".join(each.name for each in before)
                said = f"{quoted(use)} writes other columns of {quoted(series)} than were recorded before"
                self._refuse(said, path, expected=names)

    def _refuse(self, message: str, path: Path, **hints: Any) -> NoReturn:
        self._diagnosis.refuse("unsuitable", message, path, **hints)
