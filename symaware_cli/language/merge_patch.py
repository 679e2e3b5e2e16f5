"""Merges mappings of documents (JSON Merge Patch, RFC 7396)."""

from symaware_cli.language.source import MappingEntry, SourceNode


def merge(base: SourceNode, overlay: SourceNode) -> SourceNode:
    """Returns a base with an overlay merged into it, as `symaware_cli.language.compose.compose` describes it.

    Inherited keys keep their order, new ones follow.
    """
    if not isinstance(base.value, dict) or not isinstance(overlay.value, dict):
        return overlay
    entries = dict(base.value)
    for key, entry in overlay.value.items():
        inherited = entries.get(key)
        if inherited is None:
            entries[key] = entry
        elif entry.node.value is None:
            del entries[key]
        else:
            entries[key] = MappingEntry(entry.key, merge(inherited.node, entry.node))
    return SourceNode(entries, overlay.span)
