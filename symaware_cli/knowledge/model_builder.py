"""Makes the knowledge models of a scenario, those that are made from others after these."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from symaware_cli.knowledge.abstraction.knowledge_model import KnowledgeModel
from symaware_cli.knowledge.graph_text import GraphText
from symaware_cli.language import ScenarioError, SectionContext, nearest, quoted, words
from symaware_cli.world import ParameterError


class KnowledgeModelBuilder:
    """Makes the knowledge models of a scenario, and reports those that cannot be made."""

    def __init__(self, context: SectionContext) -> None:
        """Prepare.

        Args:
            context: The surroundings of the section.
        """
        self._context = context
        self._report = context.report

    def build(self, entries: Mapping[str, Any]) -> dict[str, KnowledgeModel | None]:
        """Make the models of a section, by name; None for those with a problem."""
        waiting: dict[str, KnowledgeModel] = {}
        for name, entry in entries.items():
            model = self._context.make(entry, name)
            if isinstance(model, KnowledgeModel):
                model.folder, model.open_file = self._context.folder, GraphText
                waiting[name] = model
        made: dict[str, KnowledgeModel | None] = {name: None for name in entries if name not in waiting}
        while ready := [name for name, each in waiting.items() if made.keys() >= set(each.parts().values())]:
            for name in ready:
                model = waiting.pop(name)
                others = {part: made[part] for part in model.parts().values()}
                model.others = {part: each for part, each in others.items() if each is not None}
                is_whole = len(model.others) == len(others)  # otherwise the problem is reported at the other model
                made[name] = model if is_whole and self._prepare(name, model, entries[name]) else None
        for name in waiting:
            self._report_parts(name, waiting, entries)
        return {name: made.get(name) for name in entries}

    def _prepare(self, name: str, model: KnowledgeModel, entry: Any) -> bool:
        try:
            model.prepare(self._context.regions)
        except ParameterError as error:
            if not error.is_consequence:
                self._report(str(error), name, "with", *error.place)
        except ScenarioError as error:  # in a file that the model is read from
            self._context.add(error.problems)
        except (ValueError, KeyError) as error:
            self._report(f"{quoted(entry['use'])} cannot make this: {words(error)}", name, key=True)
        else:
            return True
        return False

    def _report_parts(self, name: str, waiting: Mapping[str, KnowledgeModel], entries: Mapping[str, Any]) -> None:
        """Report the parts that a model waits for in vain: they do not exist, or are made from it."""
        for place, part in waiting[name].parts().items():
            if part not in entries:
                known = ", ".join(sorted(entries.keys() - {name})) or "none"
                said = f"there is no knowledge model `{part}`; there are: {known}"
                self._report(said, name, "with", *place, suggestion=nearest(part, entries.keys() - {name}))
            elif name in _made_from(part, waiting):
                what = "itself" if part == name else f"`{part}`, which is made from it"
                self._report(f"`{name}` cannot be made from {what}", name, "with", *place)


def _made_from(name: str, models: Mapping[str, KnowledgeModel]) -> set[str]:
    """Return a model and all that it is made from."""
    found, ahead = set[str](), [name]
    while ahead:
        name = ahead.pop()
        if name not in found:
            found.add(name)
            ahead += models[name].parts().values() if name in models else ()
    return found
