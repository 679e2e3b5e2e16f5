"""The section `knowledge_models` of scenarios."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from symaware_cli.core import Plugin
from symaware_cli.core.identifiers import Name
from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.language import Path, ScenarioSection, Section, SectionContext, Use
from symaware_cli.world import PluginKind

#: The kind of plugins that make knowledge models.
ABSTRACTION = PluginKind("abstraction", "symaware.abstractions", (KnowledgeModel,))


class KnowledgeModelUse(Use):
    """A finite transition system over the workspace."""


class KnowledgeModels(ScenarioSection):
    """Knowledge models by name; components find them in `group.sections`."""

    form: ClassVar[Any] = dict[Name, KnowledgeModelUse]
    description: ClassVar[str] = "Finite transition systems over the workspace, by name."
    uses: ClassVar[Mapping[PluginKind, type[Section]]] = {ABSTRACTION: KnowledgeModelUse}

    @classmethod
    def plugins_in(cls, written: Any) -> Iterator[tuple[PluginKind, Path, Any]]:
        """Yield each model."""
        for name, entry in written.items() if isinstance(written, Mapping) else ():
            yield ABSTRACTION, (name,), entry

    def build(self, written: Any, context: SectionContext) -> dict[str, KnowledgeModel | None]:
        """Make the models; None for each with a problem."""
        from symaware_cli.knowledge.model_builder import KnowledgeModelBuilder

        entries = written if isinstance(written, Mapping) else {}
        if context.document is None:
            return dict.fromkeys(entries)
        return KnowledgeModelBuilder(context).build(entries)

    def plugins(self, built: Mapping[str, KnowledgeModel | None]) -> Mapping[Path, Plugin]:
        """Return the models."""
        return {(name,): each for name, each in built.items() if each is not None}
