"""The catalogue of the plugins that scenarios and sweeps use."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from symaware_cli.core import Component, Environment, GroupComponent, Metric, Model
from symaware_cli.core.identifiers import NAME
from symaware_cli.engine import TIMES, Fault, Topology
from symaware_cli.entry_points import PluginError
from symaware_cli.language.scenario_section import SECTION
from symaware_cli.world import InstalledPlugins, PluginKind


class _SubscriberKind(PluginKind):
    """Functions that a scenario calls at events."""

    def fault(self, loaded: Any) -> str | None:
        """Return why an object is not a function."""
        return None if callable(loaded) and not inspect.isclass(loaded) else "is not a function of an event"


class _FaultKind(PluginKind):
    """Faults, whose names are keys of scenarios."""

    def is_name(self, name: str) -> bool:
        """Whether a key of a fault may be a name."""
        return name not in TIMES and re.fullmatch(NAME, name) is not None


#: The kinds of plugins of scenarios and sweeps.
KINDS = (
    PluginKind("component", "symaware.components", (Component, GroupComponent)),
    PluginKind("environment", "symaware.environments", (Environment,)),
    _FaultKind("fault", "symaware.faults", (Fault,)),
    PluginKind("metric", "symaware.metrics", (Metric,)),
    PluginKind("model", "symaware.models", (Model,)),
    SECTION,
    _SubscriberKind("subscriber", "symaware.subscribers", ()),
    PluginKind("topology", "symaware.topologies", (Topology,)),
)


class Catalogue(InstalledPlugins):
    """The installed plugins, by default those of scenarios and sweeps."""

    def __init__(self, kinds: Sequence[PluginKind] = KINDS) -> None:
        super().__init__(kinds)

    def add_sections(self) -> None:
        """Find plugins of the kinds that sections add as well; imports all sections."""
        for listing in self.listings(SECTION.name):
            with suppress(PluginError):
                self.add(self.load(SECTION.name, listing.name).uses)
