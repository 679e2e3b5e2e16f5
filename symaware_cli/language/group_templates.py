"""Groups that are like a template, or like another group, with changes: `templates` and `like` of a document.

They are merged before anything else looks at the document, which then has neither key. A problem with a value of a
template names the group as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from symaware_cli.language.merge_patch import merge
from symaware_cli.language.problem import nearest, quoted
from symaware_cli.language.source import MAX_NODES, MappingEntry, Path, Source, SourceNode, report_nodes
from symaware_cli.world import record

TEMPLATES, LIKE = "templates", "like"


@record
class Likeness:
    """The templates of a group.

    Attributes:
        own: The content of the group itself.
        names: The templates and groups that it is like.
        line: The line with `like`.
    """

    own: SourceNode
    names: tuple[str, ...]
    line: int


def is_about_templates(path: Path) -> bool:
    """Return whether a change of the document concerns a template, or the `like` of a group."""
    return path[:1] == (TEMPLATES,) or (path[:1] == ("agents",) and len(path) == 3 and path[2] == LIKE)


def expanded(root: SourceNode, sources: Mapping[str, Source]) -> tuple[SourceNode, Mapping[str, Likeness]]:
    """Return a document with the templates merged into groups that are like them, and these groups by name.

    Problems are added to the sources.
    """
    if not isinstance(root.value, dict):
        return root, {}
    templates = _mapping(root, TEMPLATES)
    groups = _mapping(root, "agents")
    if TEMPLATES not in root.value and not any(LIKE in (_entries(each.node) or {}) for each in groups.values()):
        return root, {}
    expansion = _Expansion(templates, groups, sources)
    whole = {name: MappingEntry(entry.key, expansion.group(name)) for name, entry in groups.items()}
    for name in templates:
        expansion.template(name)
    entries = {key: entry for key, entry in root.value.items() if key != TEMPLATES}
    if whole:
        agents = entries["agents"]
        entries["agents"] = MappingEntry(agents.key, SourceNode(whole, agents.node.span))
    result = SourceNode(entries, root.span)
    if result.size > MAX_NODES:
        report_nodes(sources[root.span.file], root.value["agents"].key)
        return root, {}
    return result, expansion.found


def _mapping(root: SourceNode, key: str) -> dict[str, MappingEntry]:
    return _entries(root.value[key].node) or {} if isinstance(root.value, dict) and key in root.value else {}


def _entries(node: SourceNode) -> dict[str, MappingEntry] | None:
    return node.value if isinstance(node.value, dict) else None


class _Expansion:
    def __init__(
        self, templates: dict[str, MappingEntry], groups: dict[str, MappingEntry], sources: Mapping[str, Source]
    ) -> None:
        self.found: dict[str, Likeness] = {}
        self._all = {(TEMPLATES, name): entry.node for name, entry in templates.items()}
        self._all |= {("agents", name): entry.node for name, entry in groups.items()}
        self._names = [*templates, *(name for name in groups if name not in templates)]
        self._sources = sources
        self._open: list[tuple[str, str]] = []
        self._done: dict[tuple[str, str], SourceNode] = {}

    def group(self, name: str) -> SourceNode:
        return self._whole(("agents", name))

    def template(self, name: str) -> SourceNode:
        return self._whole((TEMPLATES, name))

    def _whole(self, place: tuple[str, str]) -> SourceNode:
        """Return a template or group, merged with those that it is like."""
        if place in self._done:
            return self._done[place]
        node = self._all[place]
        entries = _entries(node)
        if entries is None and place[0] == TEMPLATES:
            self._report("wrong-type", f"the template {quoted(place[1])} is no mapping", node, place, "that of a group")
        if entries is None or LIKE not in entries:
            self._done[place] = node
            return node
        own = SourceNode({key: entry for key, entry in entries.items() if key != LIKE}, node.span)
        self._open.append(place)
        named = list(self._named(entries[LIKE].node, (*place, LIKE)))
        layers = [self._whole(other) for _, other in named]
        self._open.pop()
        whole: SourceNode | None = None
        for layer in (*layers, own):
            whole = layer if whole is None else merge(whole, layer)
        assert whole is not None
        self._done[place] = SourceNode(whole.value, node.span)
        if place[0] == "agents":
            names = tuple(name for name, _ in named)
            self.found[place[1]] = Likeness(own, names, entries[LIKE].node.span.line)
        return self._done[place]

    def _named(self, node: SourceNode, path: Path) -> Iterator[tuple[str, tuple[str, str]]]:
        """Yield the names under `like`, with their places."""
        for each in node.value if isinstance(node.value, list) else [node]:
            name = each.value
            if not isinstance(name, str):
                self._report("wrong-type", "`like` names a template or a group", each, path, "a name or a list of them")
                continue
            place = (TEMPLATES, name) if (TEMPLATES, name) in self._all else ("agents", name)
            if place not in self._all:
                suggestion = nearest(name, self._names)
                expected = f"one of {', '.join(sorted(self._names)[:20])}"
                message = f"no template or group is called {quoted(name)}"
                self._report("unknown-template", message, each, path, expected, suggestion)
            elif place in self._open:
                cycle = " -> ".join([*(inner for _, inner in self._open[self._open.index(place) :]), name])
                self._report("cyclic-like", f"a group cannot be like itself: {cycle}", each, path)
            else:
                yield name, place

    def _report(
        self,
        code: str,
        message: str,
        node: SourceNode,
        path: Path,
        expected: str | None = None,
        suggestion: str | None = None,
    ) -> None:
        source = self._sources[node.span.file]
        source.report(code, message, node.span, path, expected=expected, suggestion=suggestion)
