"""Metadata of the channels of parts of awareness and of signals: written by the recorder, parsed by the reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, get_args

from symaware_cli.awareness import MEASUREMENT, PARTS, Kind, Part, Signal
from symaware_cli.world import Quantity

if TYPE_CHECKING:
    from symaware_cli.log.index import ChannelInfo

SIGNAL_MESSAGES: Mapping[Kind, str] = {"vector": "Rows", "series": "SeriesRows", "table": "TableRows"}
"""The message type of the channel of a part or a signal, by its kind."""

_BUILT_IN = {part.name: part for part in PARTS}


def columns_metadata(quantities: Sequence[Quantity]) -> dict[str, str]:
    """Return the metadata that describe the columns of a channel."""
    return {
        "columns": ",".join(quantity.name for quantity in quantities),
        "units": ",".join(quantity.unit for quantity in quantities),
    }


def column_quantities(metadata: Mapping[str, str]) -> list[Quantity]:
    """Read the names and units that the metadata of a channel give its columns; missing units are empty."""
    names, units = (metadata[key].split(",") if metadata.get(key) else [] for key in ("columns", "units"))
    return [Quantity(*each) for each in zip_longest(names, units[: len(names)], fillvalue="")]


def signal_metadata(signal: Signal) -> dict[str, str]:
    """Return the metadata of the channel of a part or a signal: enough to read and draw it without the plugin."""
    known = {signal.what: signal.kind, "drawn": signal.drawn or "", "description": signal.description}
    return (columns_metadata(signal.columns) if signal.columns else {}) | known


def signal_topic(group: str, field: str, signal: Signal) -> str:
    """Return the topic of a part, or of a signal by component and name, of a group."""
    if isinstance(signal, Part):
        return f"/agents/{group}/{field}"
    return f"/agents/{group}/{signal.name}/{field.removesuffix(f'.{signal.name}')}"


def signal_of(info: ChannelInfo) -> tuple[str, Signal] | None:
    """Return the field and the part or signal that a channel holds; None if it holds something else.

    Logs of earlier versions have no kind in the metadata; they hold the built-in parts and the measurements of sensors.
    """
    _, root, _, name, component, *further = f"{info.topic}////".split("/")
    if root != "agents" or any(further) or not name:
        return None
    known: Signal | None = Signal(MEASUREMENT) if component and name == MEASUREMENT else None
    if not component:
        known = _BUILT_IN.get(name)
    signal = _announced(name, Signal if component else Part, known, info.metadata)
    if signal is None:
        return None
    return signal.field(component) if component else name, signal


def _announced(name: str, what: type[Signal], known: Signal | None, metadata: Mapping[str, str]) -> Signal | None:
    """Parse the part or signal from the metadata of a channel; without a kind there, use the known one."""
    columns = column_quantities(metadata)
    if len({column.name for column in columns}) < len(columns):
        columns = []
    kind, drawn = metadata.get(what.what), metadata.get("drawn") or None
    if kind not in get_args(Kind):
        return None if known is None else known.of(columns)
    merge = {"merge": known.merge} if isinstance(known, Part) else {}
    for how in (drawn, None):
        try:
            return what(name, kind, columns or None, how, metadata.get("description", ""), **merge)  # type: ignore[arg-type]
        except ValueError:  # of a later version or another program
            continue
    return None if known is None else known.of(columns)


def signals_of(channels: Mapping[str, ChannelInfo], group: str) -> dict[str, Signal]:
    """Return the parts and signals of a group that have channels in a log, by field: built-in parts first."""
    root = f"/agents/{group}/"
    found = dict(each for topic, info in channels.items() if topic.startswith(root) and (each := signal_of(info)))
    further = sorted(found.keys() - _BUILT_IN.keys(), key=lambda name: (not isinstance(found[name], Part), name))
    order = [*(name for name in _BUILT_IN if name in found), *further]
    return {name: found[name] for name in order}
