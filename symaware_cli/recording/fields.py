"""What a log says of the parts of awareness, and how they are found in it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import get_args

from symaware_cli.awareness.part import Drawn
from symaware_cli.core import PARTS, Part, Quantity
from symaware_cli.recording.index import ChannelInfo

PART_MESSAGES = {"vector": "Rows", "series": "SeriesRows"}
"""The message on the channel of a part, by its kind."""

_BUILT_IN = {part.name: part for part in PARTS}


def columns_metadata(quantities: Sequence[Quantity]) -> dict[str, str]:
    """What a channel says of the columns of its messages."""
    return {
        "columns": ",".join(quantity.name for quantity in quantities),
        "units": ",".join(quantity.unit for quantity in quantities),
    }


def part_metadata(part: Part) -> dict[str, str]:
    """What the channel of a part of awareness says of it: enough to read and to draw it without the plugin."""
    known = {"part": part.kind, "drawn": part.drawn or "", "description": part.description}
    return (columns_metadata(part.columns) if part.columns else {}) | known


def part_of(info: ChannelInfo) -> Part | None:
    """The part of awareness that a channel tells of; None if it tells of something else.

    Logs of former versions say nothing of the kind; they have the parts of every group.
    """
    _, root, _, name, *further = f"{info.topic}///".split("/")
    if root != "agents" or any(further) or not name:
        return None
    said = info.metadata
    part = _BUILT_IN.get(name)
    if part is None or "part" in said:
        kind, drawn = said.get("part"), said.get("drawn")
        if kind not in PART_MESSAGES or not name.isidentifier() or name != name.lower():
            return part
        known = drawn if drawn in get_args(Drawn) and (kind == "series" or drawn in ("curve", "bars")) else None
        merge = "seen-first" if part is None else part.merge
        part = Part(name, kind, None, merge, known, said.get("description", ""))  # type: ignore[arg-type]
    names, units = (said[key].split(",") if said.get(key) else [] for key in ("columns", "units"))
    distinct = len(set(names)) == len(names) > 0
    return part.of(
        [Quantity(*each) for each in zip_longest(names, units[: len(names)], fillvalue="")] if distinct else ()
    )


def parts_of(channels: Mapping[str, ChannelInfo], group: str) -> dict[str, Part]:
    """The parts of awareness of a group that a log has channels of, by name: first those of every group."""
    root = f"/agents/{group}/"
    found = {part.name: part for topic, info in channels.items() if topic.startswith(root) and (part := part_of(info))}
    order = [*(name for name in _BUILT_IN if name in found), *sorted(found.keys() - _BUILT_IN.keys())]
    return {name: found[name] for name in order}
