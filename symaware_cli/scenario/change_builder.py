"""Builds changes of components and knowledge while a run goes on, and reports problems with them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from symaware_cli.core import AgentGroup, GroupComponent
from symaware_cli.core.component import BaseComponent
from symaware_cli.runtime.faults import ComponentSelection, Effect
from symaware_cli.runtime.timed_changes import Inform, Reconfigure
from symaware_cli.scenario.compose import Composition
from symaware_cli.scenario.fault_section import Information, Reconfiguration
from symaware_cli.scenario.fault_targets import FaultTargets, ReportedError
from symaware_cli.scenario.plugin_factory import PluginFactory, mapping, words
from symaware_cli.scenario.problem import nearest, quoted
from symaware_cli.scenario.sampling import Sampler
from symaware_cli.scenario.source import Path


class ChangeBuilder:
    """Builds changes of components and knowledge."""

    def __init__(
        self,
        composition: Composition,
        report: Callable[..., None],
        factory: PluginFactory,
        targets: FaultTargets,
    ) -> None:
        self._composition = composition
        self._report = report
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
        written = mapping(self._composition.data["agents"][group.name]["components"][entry.name])
        place: Path = ("agents", group.name, "components", entry.name)
        made = self._factory.variants(written, place, changed, where, len(selected.rows))
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
        sampler = Sampler(self._composition, int(self._composition.data.get("seed", 0)), ids, len(ids) > 1, group.model)
        known = sampler.known(values, path)
        for problem in sampler.problems:
            self._report(problem.code, problem.message, path, expected=problem.expected)
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

    def _refuse(self, message: str, path: Path, **hints: Any) -> None:
        self._report("invalid-value", message, path, **hints)
        raise ReportedError


def _kind(value: Any) -> object:
    """What kind of knowledge a value is: numbers of a shape, a list of other things or of nothing, or another class."""
    try:
        numbers = np.asarray(value, float)
    except (TypeError, ValueError):
        return Sequence if isinstance(value, list | tuple) else type(value)
    return numbers.shape if numbers.shape != (0,) else Sequence
