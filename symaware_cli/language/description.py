"""Descriptions of plugins for ``symaware show``: parameters, events, knowledge, parts, signals, states."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import RootModel
from pydantic_core import to_jsonable_python

from symaware_cli.core import Model, Signal
from symaware_cli.entry_points import Listing, PluginError
from symaware_cli.language.catalogue import Catalogue
from symaware_cli.language.parts import declared_by, signals_of
from symaware_cli.language.problem import nearest
from symaware_cli.world import InstalledPlugins


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a plugin.

    Attributes:
        name: Its key under ``with:``.
        type: Its type in words.
        required: Whether it must be given.
        default: Its default value.
        description: Its meaning and unit.
    """

    name: str
    type: str
    required: bool
    default: Any
    description: str


@dataclass(frozen=True, slots=True)
class Description:
    """The description of a plugin.

    Attributes:
        kind: The name of its kind, such as ``component``.
        name: Its entry-point name.
        package: The distribution that contains it.
        version: The version of that distribution.
        text: Its docstring.
        parameters: Its parameters.
        events: The events that it fires, with their meanings.
        knowledge: The knowledge that it needs, with descriptions.
        requires: The features of the world that it needs, with the worlds that have them.
        parts: The parts of awareness that it writes besides those of every agent, with descriptions.
        signals: The signals that it publishes, with descriptions.
        state: Names and units of the state, for a model.
        control_input: Names and units of the control input, for a model.
    """

    kind: str
    name: str
    package: str
    version: str
    text: str
    parameters: tuple[Parameter, ...]
    events: dict[str, str]
    knowledge: dict[str, str]
    requires: dict[str, str]
    parts: dict[str, str]
    signals: dict[str, str]
    state: dict[str, str]
    control_input: dict[str, str]

    def to_json(self) -> dict[str, Any]:
        """Return the description as plain data."""
        return asdict(self)


def describe(name: str, catalogue: InstalledPlugins | None = None) -> list[Description]:
    """Describe every plugin with a name; usually one.

    Raises:
        PluginError: There is no such plugin, or it cannot be imported.
    """
    catalogue = catalogue or Catalogue()
    found = catalogue.find(name)
    if not found:
        known = [listing.name for kind in catalogue.kinds for listing in catalogue.listings(kind)]
        raise PluginError("unknown-plugin", f"nothing called `{name}` is installed", suggestion=nearest(name, known))
    return [
        _describe(listing, catalogue.load(listing.kind, name))
        for listing in found
        if not catalogue.is_shadowed(listing)
    ]


def _describe(listing: Listing, plugin: Any) -> Description:
    if not hasattr(plugin, "Parameters"):
        text = inspect.getdoc(plugin) or ""
        return Description(listing.kind, listing.name, listing.package, listing.version, text, (), *[{}] * 7)
    schema = plugin.Parameters.model_json_schema()
    if issubclass(plugin.Parameters, RootModel):
        # A single value, which has no name but that of the plugin.
        root = {**schema, "description": plugin.Parameters.model_fields["root"].description or ""}
        schema = {"properties": {listing.name: root}, "required": [listing.name], "$defs": schema.get("$defs", {})}
    required = schema.get("required", [])
    # The schema does not contain defaults made by factories, such as lists.
    defaults = {
        field.alias or name: to_jsonable_python(field.get_default(call_default_factory=True))
        for name, field in plugin.Parameters.model_fields.items()
        if not field.is_required()
    }
    parameters = tuple(
        Parameter(
            name,
            in_words(entry, schema.get("$defs", {})),
            name in required,
            defaults.get(name),
            entry.get("description", ""),
        )
        for name, entry in schema.get("properties", {}).items()
    )
    is_model = issubclass(plugin, Model)
    return Description(
        listing.kind,
        listing.name,
        listing.package,
        listing.version,
        inspect.getdoc(plugin) or "",
        parameters,
        dict(getattr(plugin, "events", {})),
        dict(getattr(plugin, "knowledge", {})),
        dict(getattr(plugin, "requires", {})),
        {part.name: _describe_signal(part) for part in declared_by(plugin)},
        {signal.name: _describe_signal(signal) for signal in signals_of(plugin)},
        {quantity.name: quantity.unit for quantity in plugin.state} if is_model else {},
        {quantity.name: quantity.unit for quantity in plugin.control_input} if is_model else {},
    )


def _describe_signal(signal: Signal) -> str:
    columns = f" of {', '.join(signal.column_names)}" if signal.columns else ""
    return f"a {signal.kind}{columns}" + (f": {signal.description}" if signal.description else "")


_BOUNDS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
_TYPES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "list",
    "object": "mapping",
    "null": "null",
}


def in_words(entry: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    """Describe the JSON schema of a parameter in a few words, such as ``number > 0``."""
    if "$ref" in entry:
        return in_words(definitions.get(entry["$ref"].rpartition("/")[2], {}), definitions)
    if "anyOf" in entry:
        return " or ".join(dict.fromkeys(in_words(each, definitions) for each in entry["anyOf"]))
    if "enum" in entry:
        return " or ".join(str(value) for value in entry["enum"])
    if "const" in entry:
        return str(entry["const"])
    words = _TYPES.get(entry.get("type", ""), "anything")
    if words == "list" and isinstance(entry.get("items"), Mapping):
        words += f" of {in_words(entry['items'], definitions)}"
    bounds = [f"{sign} {entry[key]:g}" for key, sign in _BOUNDS.items() if key in entry]
    return " ".join([words, " and ".join(bounds)]).strip()
