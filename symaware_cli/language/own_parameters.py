"""Creates the components of agents that have parameters of their own, and checks that they fit beside the others.

Reasons: docs/decisions/0078-parameters-of-one-agent.md
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from symaware_cli.core import (
    AgentGroup,
    Component,
    GroupCommunicationReceiver,
    GroupComponent,
)
from symaware_cli.engine import ComponentEntry
from symaware_cli.language.diagnosis import Diagnosis
from symaware_cli.language.plugin_factory import PluginFactory, mapping
from symaware_cli.language.problem import dotted, quoted
from symaware_cli.language.source import Path

#: The key of a component's section for the parameters of single agents.
OWN = "own"


class Variation(NamedTuple):
    """A component with other parameters, and the agents that use it.

    Attributes:
        component: The component; that of the first of the agents unless it is a group component.
        rows: The rows of the agents, ascending.
        path: Where their parameters are written.
    """

    component: Component | GroupComponent
    rows: Sequence[int]
    path: Path


class OwnParameters:
    """Creates components with parameters of single agents, and reports problems with them."""

    def __init__(self, diagnosis: Diagnosis, factory: PluginFactory) -> None:
        self._report = diagnosis.report
        self._factory = factory

    def variations(
        self, entry: Mapping[str, Any], path: Path, common: Component | GroupComponent, count: int
    ) -> Sequence[Variation] | None:
        """Create the components of the agents that have parameters of their own.

        Agents that have the same ones share a group component.

        Args:
            entry: The section of the component.
            path: Its path.
            common: The component with the parameters under ``with``.
            count: The number of agents.

        Returns:
            The variations, in the order of their first agents; None after a problem.
        """
        rows: dict[str, list[int]] = {}
        written = mapping(entry.get(OWN))
        for number in written:
            if not (number.isascii() and number.isdecimal()):
                return None  # which the document's types rule out
            if int(number) < count:
                rows.setdefault(repr(written[number]), []).append(int(number))
            else:
                said, expected = f"there is no agent {number}", f"0 to {count - 1}"
                self._report("wrong-count", said, (*path, OWN, number), key=True, expected=expected)
                return None
        chosen = [sorted(each) for each in rows.values()]
        if not isinstance(common, GroupComponent):
            chosen = [[row] for each in chosen for row in each]
        found = []
        for each in sorted(chosen):
            where = (*path, OWN, str(each[0]))
            made = self._made(entry, path, mapping(written[str(each[0])]), where, common)
            if made is None:
                return None
            found.append(Variation(made, each, where))
        return found

    def _made(
        self, entry: Mapping[str, Any], path: Path, own: Mapping[str, Any], where: Path, common: Any
    ) -> Component | GroupComponent | None:
        use = quoted(str(entry["use"]))
        if isinstance(common, GroupCommunicationReceiver):
            self._report("unsuitable", f"{use} reads the messages to all agents of the group at once", where, key=True)
            return None
        if common.specifications is not None and common.specifications in own:
            said = f"{quoted(common.specifications)} is one for all agents: it names specifications"
            self._report("unsuitable", said, (*where, common.specifications), key=True)
            return None
        made = self._factory.variants(entry, path, parameters_of(entry, int(where[-1])), where, 1)
        if not made:
            return None
        if [*made[0].parts, *made[0].signals] != [*common.parts, *common.signals]:
            self._refuse_other_values(use, where)
            return None
        component: Component | GroupComponent = made[0]
        return component

    def records_alike(self, variation: Variation, common: Component | GroupComponent, group: AgentGroup) -> bool:
        """Check that a component records the same columns as that of the other agents."""
        alike = variation.component.series_quantities(group) == common.series_quantities(group)
        if not alike:
            self._refuse_other_values(quoted(dotted(variation.path[:-2])), variation.path)
        return alike

    def _refuse_other_values(self, who: str, where: Path) -> None:
        said = f"{who} would record other values with these parameters than for the other agents"
        self._report("unsuitable", said, where, key=True, expected="agents that record other values as their own group")


def parameters_of(entry: Mapping[str, Any], row: int) -> Mapping[str, Any]:
    """Return the parameters of a component of one agent, those of its own included, from the component's section."""
    own = mapping(mapping(entry.get(OWN)).get(str(row)))
    merged = {**mapping(entry.get("with")), **own}
    return {name: value for name, value in merged.items() if name not in own or value is not None}


def entries_of(
    group: AgentGroup, name: str, use: str, components: Sequence[Any], variations: Sequence[Variation]
) -> Sequence[ComponentEntry]:
    """Return the entries of a component: one, or one for each set of parameters of a group component.

    Args:
        group: The group.
        name: The name of the component.
        use: Its entry-point name.
        components: The components with common parameters, by row; one for a group component.
        variations: The components of agents with parameters of their own.
    """
    own = [row for each in variations for row in each.rows]
    if not isinstance(components[0], GroupComponent):
        others = {each.rows[0]: each.component for each in variations}
        made = [others.get(row, component) for row, component in enumerate(components)]
        return [ComponentEntry(group, name, use, made, own=own)]
    if not own:
        return [ComponentEntry(group, name, use, components)]
    rest = sorted({*range(len(group))} - {*own})
    common = [ComponentEntry(group, name, use, components, rows=rest)] if rest else []
    return [
        *common,
        *(ComponentEntry(group, name, use, [each.component], own=each.rows, rows=each.rows) for each in variations),
    ]
