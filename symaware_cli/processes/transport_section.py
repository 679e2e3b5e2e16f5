"""The section `transport` of scenarios."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from symaware_cli.core import Plugin
from symaware_cli.language import Path, ScenarioSection, Section, SectionContext, Use
from symaware_cli.processes.transport import Transport
from symaware_cli.world import PluginKind

#: The kind of plugins that carry frames between processes.
TRANSPORT = PluginKind("transport", "symaware.transports", (Transport,))


class TransportUse(Use):
    """The transport of a run in several processes."""


class TransportSection(ScenarioSection):
    """How the processes of a run reach each other."""

    form: ClassVar[Any] = TransportUse | None
    description: ClassVar[str] = (
        "The transport of a run in several processes, with --listen and --join; `tcp` by default. A run in one process "
        "does not use it."
    )
    uses: ClassVar[Mapping[PluginKind, type[Section]]] = {TRANSPORT: TransportUse}

    @classmethod
    def plugins_in(cls, written: Any) -> Iterator[tuple[PluginKind, Path, Any]]:
        """Yield the transport."""
        yield TRANSPORT, (), written

    def build(self, written: Any, context: SectionContext) -> Plugin | None:
        """Create the transport."""
        return context.make(written)

    def plugins(self, built: Plugin | None) -> Mapping[Path, Plugin]:
        """Return it."""
        return {} if built is None else {(): built}
