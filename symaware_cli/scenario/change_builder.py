"""Builds changes of components and knowledge while a run goes on, and reports problems with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from symaware_cli.core import AgentGroup, Component, GroupComponent, nanoseconds
from symaware_cli.core.component import BaseComponent
from symaware_cli.runtime.faults import ComponentSelection, Effect
from symaware_cli.runtime.simulation import ComponentEntry
from symaware_cli.runtime.timed_changes import Inform, Reconfigure, Replace
from symaware_cli.scenario.diagnosis import Diagnosis, ReportedError
from symaware_cli.scenario.document import ScenarioDocument
from symaware_cli.scenario.fault_section import FaultUse, Information, Reconfiguration
from symaware_cli.scenario.fault_targets import FaultTargets
from symaware_cli.scenario.group_builder import ComponentCheck
from symaware_cli.scenario.parts import declared_signals
from symaware_cli.scenario.plugin_factory import PluginFactory, mapping, words
from symaware_cli.scenario.problem import nearest, quoted
from symaware_cli.scenario.sampling import Sampler
from symaware_cli.scenario.source import Path
from symaware_cli.scenario.timing_check import TimingCheck


class ChangeBuilder:
    """Builds changes of components and knowledge."""

    def __init__(self, diagnosis: Diagnosis, factory: PluginFactory, targets: FaultTargets) -> None:
        self._diagnosis = diagnosis
        self._data = diagnosis.composition.data
        self._factory = factory
        self._targets = targets

    def reconfigure(self, use: Reconfiguration, path: Path) -> tuple[str, str, Effect]:
        """Build a change of parameters: its target, a description for people, and the effect."""
        selected = self._targets.own_components(use.of, (*path, "of"))
        substitutes = [self._substitutes(each, use.with_, path) for each in selected]
        parameters = ", ".join(use.with_)
        return f"agents.{use.of}", f"changes {parameters} of {use.of}", Reconfigure(selected, substitutes)

    def _substitutes(
        self, selected: ComponentSelection, changed: Mapping[str, Any], path: Path
    ) -> Sequence[BaseComponent[Any]]:
        """Create a component with other parameters for each one that is selected, and check that it can work."""
        entry, where = selected.entry, (*path, "with")
        group, present = entry.group, entry.components[0]
        if entry.timing.in_process:
            self._refuse(f"{quoted(entry.name)} runs in a process of its own, where its parameters are fixed", path)
        if isinstance(present, GroupComponent) and len(selected.rows) < len(group):
            self._refuse(f"{quoted(entry.name)} is one component for all of {quoted(group.name)}", (*path, "of"))
        if present.specifications is not None and present.specifications in changed:
            self._refuse(f"{quoted(present.specifications)} is fixed: it names specifications", where)
        written = mapping(self._data["agents"][group.name]["components"][entry.name])
        made = self._factory.variants(written, entry.section, changed, where, len(selected.rows))
        if not made:
            raise ReportedError
        if [*made[0].parts, *made[0].signals] != [*present.parts, *present.signals]:
            self._refuse(f"{quoted(entry.use)} would record other values with these parameters", where)
        try:
            made[0].check(group)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._refuse(f"{quoted(entry.use)} cannot work here: {words(error)}", where)
        return made

    def inform(self, use: Information, path: Path) -> tuple[str, str, Effect]:
        """Build a change of knowledge: its target, a description for people, and the effect."""
        agents = self._targets.agents(use.of, (*path, "of"))
        known = [self._known(group, rows, use.knowledge, (*path, "knowledge")) for group, rows in agents]
        return f"agents.{use.of}", f"tells {use.of} another {', '.join(use.knowledge)}", Inform(agents, known)

    def _known(
        self, group: AgentGroup, rows: Sequence[int], values: Mapping[str, Any], path: Path
    ) -> Sequence[Mapping[str, Any]]:
        """Determine the new knowledge of some agents, and check that it is of the same kind as the present one."""
        ids = [group.ids[row] for row in rows]
        sampler = Sampler(self._diagnosis.composition, int(self._data.get("seed", 0)), ids, len(ids) > 1, group.model)
        known = sampler.known(values, path)
        for problem in sampler.problems:
            self._diagnosis.report(problem.code, problem.message, path, expected=problem.expected)
        if sampler.problems:
            raise ReportedError
        for name in values:
            before = dict(group.knowledge[rows[0]])
            if name not in before:
                self._refuse(
                    f"{quoted(group.name)} has no knowledge {quoted(name)}",
                    (*path, name),
                    suggestion=nearest(name, before),
                    key=True,
                )
            was = before[name]
            if _kind(was) != _kind(known[0][name]):
                shown = was.tolist() if isinstance(was, np.ndarray) else was
                message = f"the knowledge {quoted(name)} is of another kind"
                self._refuse(message, (*path, name), expected=f"as {shown!r}")
        return known

    def _refuse(self, message: str, path: Path, **hints: Any) -> NoReturn:
        self._diagnosis.refuse("invalid-value", message, path, **hints)


class ReplacementBuilder:
    """Builds replacements of components."""

    def __init__(
        self,
        factory: PluginFactory,
        targets: FaultTargets,
        timing_check: TimingCheck,
        document: ScenarioDocument,
        entries: list[ComponentEntry],
    ) -> None:
        """Prepare.

        Args:
            factory: Creates components.
            targets: Finds the components to replace.
            timing_check: Checks the times of turns, and takes problems.
            document: The validated document.
            entries: All component entries, with their timing; `build` adds each substitute after what it replaces.
        """
        self._diagnosis = timing_check.diagnosis
        self._data = self._diagnosis.composition.data
        self._factory = factory
        self._targets = targets
        self._timing_check = timing_check
        self._component_check = ComponentCheck(self._diagnosis)
        self._document = document
        self._entries = entries

    def build(self, name: str, fault: FaultUse, path: Path) -> tuple[str, str, Effect]:
        """Build the replacement of a fault: its target, a description for people, and the effect.

        Args:
            name: The fault.
            fault: Its section.
            path: The path of the replacement in it.
        """
        use = fault.replace
        assert use is not None
        selected = self._targets.own_components(use.of, (*path, "of"))
        replaced = [(each, self._substitute(name, each, use.use, path)) for each in selected]
        for before, substitute in replaced:
            self._entries.insert(self._entries.index(before.entry) + 1, substitute)
            self._check_reconfigured(name, fault, before)
        return f"agents.{use.of}", f"replaces {use.of} by {use.use}", Replace(replaced)

    def _substitute(self, fault: str, selected: ComponentSelection, use: str, path: Path) -> ComponentEntry:
        """Create a component in place of another one, and check that it can work there."""
        entry, group = selected.entry, selected.entry.group
        section = mapping(self._data["agents"][group.name])
        made = self._factory.make(mapping(self._data["faults"][fault]["replace"]), path, len(group))
        if not made:
            raise ReportedError
        first: Component | GroupComponent = made[0]
        if not self._component_check.knows(first, section.get("knowledge", {}), path, group.name, use):
            raise ReportedError
        self._check_place(entry, first, selected, use, path)
        self._declare(group, entry.name, first, use, path)
        if not self._component_check.can_work(group, first, path, use):
            raise ReportedError
        written = self._document.agents[group.name].components[entry.name]
        timing = self._timing_check.timing(written, group, type(first), path)
        return ComponentEntry(group, entry.name, use, made, timing, fault)

    def _check_place(
        self,
        entry: ComponentEntry,
        component: Component | GroupComponent,
        selected: ComponentSelection,
        use: str,
        path: Path,
    ) -> None:
        """Check that a component fits in the place of another one, which the run has prepared."""
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
        """Let the group have the signals of a component, and check that what it writes agrees with what there is."""
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

    def _check_reconfigured(self, name: str, fault: FaultUse, selected: ComponentSelection) -> None:
        """Check that no other fault changes parameters of a component while it is replaced."""
        if fault.at is None:
            return
        begin = nanoseconds(fault.at)
        end = None if fault.for_ is None else begin + nanoseconds(fault.for_)
        for other, use in self._document.faults.items():
            if use.reconfigure is None or use.at is None:
                continue
            now, where = nanoseconds(use.at), ("faults", other, "reconfigure", "of")
            if now < begin or (end is not None and now >= end):
                continue
            for each in self._targets.own_components(use.reconfigure.of, where):
                if each.entry is selected.entry and not set(each.rows).isdisjoint(selected.rows):
                    said = f"at {use.at:g} s {quoted(use.reconfigure.of)} is replaced by the fault {quoted(name)}"
                    self._refuse(said, where, expected="another `replace`, or a time outside of it")

    def _refuse(self, message: str, path: Path, **hints: Any) -> NoReturn:
        self._diagnosis.refuse("unsuitable", message, path, **hints)


def _kind(value: Any) -> object:
    """What kind of knowledge a value is: numbers of a shape, a list of other things or of nothing, or another class."""
    try:
        numbers = np.asarray(value, float)
    except (TypeError, ValueError):
        return Sequence if isinstance(value, list | tuple) else type(value)
    return numbers.shape if numbers.shape != (0,) else Sequence
