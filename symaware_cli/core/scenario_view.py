"""A whole scenario, as seen by a plugin that checks it before a run.

Reasons: docs/decisions/0068-plugins-check-the-scenario.md
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

from symaware_cli.core.agent import AgentGroup
from symaware_cli.core.environment import Environment
from symaware_cli.core.links import Links

Path = tuple[str | int, ...]


class DurationView(Protocol):
    """A duration that is constant or drawn."""

    @property
    def is_zero(self) -> bool:
        """Whether it is always zero."""

    @property
    def is_drawn(self) -> bool:
        """Whether it is random."""


class TriggerView(Protocol):
    """An event that triggers turns."""

    @property
    def source(self) -> str | None:
        """The path of the events; None for events of the same agent."""


class TimingView(Protocol):
    """When the components of an entry take their turns; times in nanoseconds."""

    @property
    def period(self) -> int | None:
        """Time between two turns; None for a turn at each step of the world, or for triggered turns only."""

    @property
    def offset(self) -> int:
        """The time of the first turn."""

    @property
    def jitter(self) -> int:
        """The greatest random delay of a turn."""

    @property
    def trigger(self) -> TriggerView | None:
        """The event that triggers turns."""

    @property
    def condition(self) -> object | None:
        """The condition under which turns are taken; None if they always are."""

    @property
    def latency(self) -> DurationView:
        """The time that computations take."""

    def is_steady(self, time_step: int) -> bool:
        """Whether there is exactly one turn at each step of the world."""


class EntryView(Protocol):
    """A component entry of a group: one instance for each agent, or a single group component."""

    @property
    def group(self) -> AgentGroup:
        """The group."""

    @property
    def name(self) -> str:
        """The key of the entry in the scenario."""

    @property
    def use(self) -> str:
        """The entry-point name of the plugin."""

    @property
    def components(self) -> Sequence[Any]:
        """The components, by row; one for a group component."""

    @property
    def section(self) -> Path:
        """The path of its section in the scenario."""

    @property
    def timing(self) -> TimingView:
        """When the components take their turns."""


class ScenarioView(ABC):
    """A whole scenario as one of its plugins sees it; takes the problems that this plugin reports.

    Attributes:
        document: The validated scenario: its sections are attributes, by the names that they have in the file.
        section: The path of the plugin's own section.
        entry: The component entry that the plugin is; None for other kinds of plugins.
        entries: All component entries: groups in the order of the file, the components of each in order of execution.
        environment: The environment.
        is_initialised: Whether the environment has placed all bodies. It has not if the scenario has problems already;
            then only checks that need no world are possible.
        groups: All groups, in the order of the roster.
        links: Which agents can send messages to which; None if links change, or if all agents reach each other.
        network_changes: Whether links change during the run.
        specifications: The `symaware_cli.specification.specification.Specification` of each name.
        steps: The greatest number of steps of the run.
    """

    document: Any
    section: Path
    entry: EntryView | None
    entries: Sequence[EntryView]
    environment: Environment
    is_initialised: bool
    groups: Sequence[AgentGroup]
    links: Links | None
    network_changes: bool
    specifications: Mapping[str, Any]
    steps: int

    @property
    def own_entries(self) -> Sequence[EntryView]:
        """The component entries of the plugin's own group, in order of execution."""
        return [each for each in self.entries if self.entry is not None and each.group is self.entry.group]

    @property
    def before(self) -> Sequence[EntryView]:
        """Those of them that take their turns before the plugin."""
        own = self.own_entries
        return own[: next((place for place, each in enumerate(own) if each is self.entry), 0)]

    @property
    def after(self) -> Sequence[EntryView]:
        """Those of them that take their turns after the plugin."""
        return self.own_entries[len(self.before) + 1 :]

    @property
    def named_specifications(self) -> Mapping[str, Any]:
        """Those of `specifications` that the plugin, a component, names in its parameter for specifications."""
        component = None if self.entry is None else self.entry.components[0]
        if component is None or component.specifications is None:
            return {}
        names = getattr(component.parameters, component.specifications)
        return {name: self.specifications[name] for name in names}

    @abstractmethod
    def report(
        self,
        message: str,
        *place: str | int,
        section: Path | None = None,
        key: bool = True,
        code: str = "unsuitable",
        expected: str | None = None,
    ) -> None:
        """Refuse the scenario.

        Args:
            message: A sentence for the author of the scenario, without a full stop.
            place: The keys below the section, such as ``"with", "weights"``. If the scenario has no such key, the
                problem is located at the section itself.
            section: The path of a section; that of the plugin by default.
            key: Whether the message is about the key at that place, not its value.
            code: A stable identifier of the kind of problem.
            expected: A description of valid values.
        """

    @abstractmethod
    def report_unknown(self, kind: str, name: str, *place: str | int, known: Iterable[str]) -> None:
        """Refuse an unknown name of a kind of object, and list the valid names.

        Args:
            kind: The kind of object that was to be named, such as ``agent``.
            name: The name, or a pattern.
            place: Its keys below the plugin's section.
            known: All valid names.
        """

    @abstractmethod
    def warn(
        self,
        message: str,
        *place: str | int,
        section: Path | None = None,
        key: bool = False,
        code: str = "reservation",
        expected: str | None = None,
    ) -> None:
        """Warn the author of the scenario of a valid but probably unintended value; arguments as for `report`."""
